// The teacher's page: the pages of the study, and the trial with the spacebar as its only control.

import { cardOf } from "./card.js";
import { el } from "./dom.js";
import { Spacebar } from "./keyboard.js";
import { PageScreen } from "./pages.js";
import { moment } from "./wire.js";
import { told, words } from "./words.js";
import { WorldView } from "./world.js";

const END = 3000; // ms that the end of a trial stays in view before the next page

export function start(root, wire, welcome) {
  const say = words(welcome.texts);
  let presses = 0;
  let screen = null;
  let next = null; // the page that follows the end of a trial, once it was seen
  let broken = false;

  const answer = (index) => (values) => wire.send({ type: "answer", index, values });
  const pressed = (at) => wire.send({ type: "press", n: (presses += 1), at });
  const focused = (on, at) => wire.send({ type: "focus", on, at });

  function put(page) {
    next = null;
    screen?.leave?.();
    if (page.kind === "trial") screen = new TrialScreen(root, page, { say, pressed, focused });
    else screen = new PageScreen(root, page, { say, answer: answer(page.index) });
    if (page.kind === "gone") wire.stop();
  }

  function turn(page) {
    const again = broken;
    broken = false;
    if (screen?.shows(page)) {
      if (again) screen.again();
    } else if (screen?.endedAt && page.kind !== "gone") {
      if (!next) setTimeout(() => put(next), Math.max(0, screen.endedAt + END - performance.now()));
      next = page;
    } else put(page);
  }

  return {
    receive(message) {
      if (message.type === "page") turn(message);
      else if (message.type === "frame") screen?.frame?.(message);
      else if (message.type === "problem") screen?.problem?.(message.text);
    },
    lost() {
      broken = true;
      screen?.lost?.();
    },
  };
}

/** A trial: the world, the card in its corner, what the robot just did; nothing in it takes the focus. */
class TrialScreen {
  constructor(root, page, { say, pressed, focused }) {
    Object.assign(this, { page, say, connected: true, state: "count", endedAt: 0 });
    const { content } = page;
    const stage = el("div", { class: "stage" });
    this.told = el("p", { class: "told", "aria-live": "polite" });
    this.banner = el("p", { class: "banner", role: "status" });
    const hint = el("p", { class: "hint" }, say("trial_hint"));
    const card = content.sentence ? cardOf(content, say, say("trial_card")) : null;
    const parts = [el("div", { class: "side" }, card, hint), stage, this.told, this.banner];
    this.section = el("section", { class: "trial", role: "application", tabindex: "-1" }, parts);
    root.replaceChildren(this.section);
    document.body.classList.add("still");
    this.section.focus({ preventScroll: true });
    this.view = new WorldView(stage, { say });
    this.keys = new Spacebar({
      pressed: (at) => {
        const running = this.connected && this.state === "run";
        if (running) this.view.press();
        if (this.connected && !this.endedAt) pressed(at);
      },
      focused: (on, at) => {
        focused(on, at);
        this.#says();
      },
    });
    if (!this.keys.has) focused(false, moment());
    this.#says();
  }

  shows(page) {
    return page.kind === "trial" && page.index === this.page.index && !this.endedAt;
  }

  frame(frame) {
    this.state = frame.state;
    this.view.show(frame);
    const text = told(this.say, frame);
    if (text) this.told.textContent = text;
    if (frame.state === "over" && !this.endedAt) this.endedAt = performance.now();
    this.final = frame.final.length > 0;
    this.#says();
  }

  /** The connection is gone: from now on presses count for nothing. */
  lost() {
    this.connected = false;
    this.#says();
  }

  /** It is back, and this trial goes on. */
  again() {
    this.connected = true;
    if (!this.keys.has) this.keys.focused(false, moment());
    this.#says();
  }

  leave() {
    this.keys.release();
    document.body.classList.remove("still");
  }

  /** The one thing that the teacher must know now, if any. */
  #says() {
    const end = this.final ? "" : "trial_over";
    const byState = { count: "trial_ready", pause: "trial_paused", over: end, run: "" };
    let key = byState[this.state];
    if (!this.keys.has && !this.endedAt) key = "trial_focus_lost";
    if (!this.connected && !this.endedAt) key = "trial_connection_lost";
    const text = key ? this.say(key) : "";
    if (this.banner.textContent !== text) this.banner.textContent = text;
    this.section.classList.toggle("warned", /lost/.test(key));
  }
}
