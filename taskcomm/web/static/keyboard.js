// The spacebar during a trial: its presses, and whether this page has the keyboard at all.

import { moment } from "./wire.js";

const PLAIN = (event) => !event.ctrlKey && !event.metaKey && !event.altKey;

/**
 * Takes the keyboard until `release()`. `pressed(at)`: the spacebar went down, once however long it is held.
 * `focused(on, at)`: the page lost or got back the keyboard. No other key does anything in the page.
 */
export class Spacebar {
  constructor({ pressed, focused }) {
    Object.assign(this, { pressed, focused });
    this.down = false;
    this.has = this.#hasKeyboard();
    this.done = new AbortController();
    const { signal } = this.done;
    const options = { signal, capture: true };
    window.addEventListener("keydown", (event) => this.#keydown(event), options);
    window.addEventListener("keyup", (event) => this.#keyup(event), options);
    const look = (event) => this.#look(event);
    for (const name of ["blur", "focus"]) window.addEventListener(name, look, { signal });
    document.addEventListener("visibilitychange", look, { signal });
  }

  release() {
    this.done.abort();
  }

  #keydown(event) {
    if (event.code !== "Space" && event.key !== " ") {
      if (PLAIN(event) && !/^F\d+$/.test(event.key)) event.preventDefault();
      return;
    }
    event.preventDefault();
    event.stopPropagation();
    if (event.repeat || this.down) return;
    this.down = true;
    this.pressed(moment(event.timeStamp));
  }

  #keyup(event) {
    if (event.code !== "Space" && event.key !== " ") return;
    event.preventDefault();
    this.down = false;
  }

  #hasKeyboard() {
    return document.hasFocus() && document.visibilityState === "visible";
  }

  #look(event) {
    const has = event.type === "blur" ? false : event.type === "focus" || this.#hasKeyboard();
    if (has === this.has) return;
    this.has = has;
    if (!has) this.down = false;
    this.focused(has, moment(event.timeStamp));
  }
}
