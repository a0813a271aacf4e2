// The time bar of a replay: a slider over the frames, play and pause, speeds, steps, the presses.

import { el } from "./dom.js";
import { button } from "./tools.js";

const SPEEDS = [0.5, 1, 2, 4, 8];

const BEFORE = 5; // seconds that are played before a press

/**
 * A position among `count` frames, each of `dt` seconds. `moved(at, played)` is called at each change;
 * `jumps` are the positions of presses, `time(at)` is in seconds, `told(at)` says what is there.
 */
export class TimeBar {
  constructor(parent, { count, dt, jumps, time, moved, told }) {
    Object.assign(this, { count, dt, jumps, time, moved, told });
    this.at = 0;
    this.until = count - 1;
    this.slider = el("input", {
      type: "range", min: 0, max: count - 1, step: 1, value: 0, class: "slider", "aria-label": "Time",
      oninput: () => this.go(Number(this.slider.value)),
    });
    this.button = button("Play", () => this.toggle(), { class: "play" });
    this.speed = el(
      "select",
      { "aria-label": "Speed", onchange: () => this.timer && this.#restart() },
      ...SPEEDS.map((speed) => el("option", { value: speed, selected: speed === 1 }, `${speed} ×`)),
    );
    const small = (text, name, go) => button(text, go, { title: name, "aria-label": name });
    this.clock = el("output", { class: "clock" });
    parent.append(
      el(
        "div",
        { class: "timebar", role: "group", "aria-label": "Time bar" },
        this.button,
        small("◀", "One step back (left arrow)", () => this.go(this.at - 1)),
        small("▶", "One step on (right arrow)", () => this.go(this.at + 1)),
        small("◀ press", "The press before (p)", () => this.jump(-1)),
        small("press ▶", "The next press (n)", () => this.jump(1)),
        small(`last ${BEFORE} s`, `Play the last ${BEFORE} seconds (b)`, () => this.again()),
        this.slider,
        this.clock,
        el("label", { class: "speed" }, "Speed ", this.speed),
      ),
    );
    this.#drawButton();
  }

  /** Moves to position `at`, held within the trial; a step taken by hand pauses. */
  go(at, played = false) {
    if (!played) this.pause();
    this.at = Math.max(0, Math.min(this.count - 1, at));
    this.slider.value = this.at;
    this.clock.textContent = `${this.time(this.at).toFixed(1)} of ${this.time(this.count - 1).toFixed(1)} s`;
    this.slider.setAttribute("aria-valuetext", this.told(this.at));
    this.moved(this.at, played);
  }

  /** To the next press (1) or the one before (-1). */
  jump(direction) {
    const ahead = this.jumps.filter((at) => direction * (at - this.at) > 0);
    if (ahead.length) this.go(direction > 0 ? ahead[0] : ahead.at(-1));
  }

  /** Plays the seconds that led here, up to here. */
  again() {
    const until = this.at;
    this.go(until - Math.round(BEFORE / this.dt));
    this.until = until;
    this.#restart();
  }

  toggle() {
    if (this.timer) this.pause();
    else this.play();
  }

  play() {
    if (this.at >= this.count - 1) this.go(0);
    this.#restart();
  }

  pause() {
    clearInterval(this.timer);
    this.timer = null;
    this.until = this.count - 1;
    this.#drawButton();
  }

  #restart() {
    clearInterval(this.timer);
    this.timer = setInterval(() => this.#tick(), (1000 * this.dt) / Number(this.speed.value));
    this.#drawButton();
  }

  #tick() {
    if (this.at < this.until) this.go(this.at + 1, true);
    if (this.at >= this.until) this.pause();
  }

  #drawButton() {
    this.button.textContent = this.timer ? "Pause" : "Play";
    this.button.setAttribute("aria-label", this.timer ? "Pause (space)" : "Play (space)");
  }

  /** What a key does, wherever the focus is; true where it did something. */
  key(event) {
    const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 }[event.key];
    if (event.key === " ") this.toggle();
    else if (steps) this.go(this.at + steps);
    else if (event.key === "Home") this.go(0);
    else if (event.key === "End") this.go(this.count - 1);
    else if (event.key === "n") this.jump(1);
    else if (event.key === "p") this.jump(-1);
    else if (event.key === "b") this.again();
    else return false;
    return true;
  }
}
