// The presses of a trial in a table: to an admin why each was made, to an annotator the question.

import { el } from "./dom.js";
import { button } from "./tools.js";

const MEANINGS = {
  mistake: ["Mistake", "no approval: a slip, or it was meant otherwise"],
  that_mov: ["That Mov", "yes, this ball is the one to move"],
  that_wrt: ["That WRT", "yes, this ball is the one to move it to"],
  that_dist: ["That Dist", "yes, this is the distance"],
};

/** The name of a mental state, and what it means. */
export const meaning = (state) => MEANINGS[state] ?? [state.replaceAll("_", " "), ""];

const seconds = (t, dt) => ((t + 1) * dt).toFixed(1);

/** Shared by both tables: rows by press, the current one marked; `pick(t)` goes to a press. */
class Presses {
  constructor(replay, pick) {
    Object.assign(this, { replay, pick });
  }

  /** Marks the last press up to step `t`. */
  show(t) {
    const now = this.replay.presses.findLastIndex((press) => press.t <= t);
    this.rows.forEach((row, i) => row.classList.toggle("now", i === now));
    this.now = now;
  }

  when(press) {
    const text = `${seconds(press.t, this.replay.dt)} s`;
    return el("th", { scope: "row" }, button(text, () => this.pick(press.t), { class: "link" }));
  }
}

/** Why each press was made: bars for what is believed with the whole trial known, ticks for just then. */
export class Reasons extends Presses {
  constructor(parent, replay, pick) {
    super(replay, pick);
    this.rows = replay.presses.map((press) => this.#row(press));
    const states = this.#states();
    const heads = ["Press at", ...states.map((state) => meaning(state)[0]), "Labels"];
    if (this.#noted()) heads.push("In truth");
    const caption = "Why each press was made: bars with the whole trial known, ticks as believed just then";
    parent.append(
      el(
        "table",
        { class: "reasons" },
        el("caption", {}, caption),
        el("thead", {}, el("tr", {}, ...heads.map((head) => el("th", { scope: "col" }, head)))),
        el("tbody", {}, ...this.rows),
      ),
    );
  }

  /** Whether the log itself says why, as simulated ones do. */
  #noted() {
    return this.replay.presses.some((press) => press.noted);
  }

  #states() {
    return this.replay.reasons.length ? Object.keys(this.replay.reasons[0].at_end) : [];
  }

  #row(press) {
    const reason = this.replay.reasons[this.replay.presses.indexOf(press)];
    const { at_end: end, at_once: once } = reason ?? {};
    const bars = this.#states().map((state) => el("td", {}, bar(end[state], once[state])));
    const said = Object.entries(press.labels).map(([who, state]) => `${who}: ${meaning(state)[0]}`);
    const truly = this.#noted() ? el("td", {}, press.noted ? meaning(press.noted)[0] : "") : null;
    return el("tr", {}, this.when(press), ...bars, el("td", {}, said.join(", ") || "–"), truly);
  }
}

function bar(share, once) {
  const [fill, tick] = [el("span", { class: "fill" }), el("span", { class: "once" })];
  fill.style.width = `${100 * share}%`;
  tick.style.left = `${100 * once}%`;
  const title = `just then ${once.toFixed(2)}, with the whole trial ${share.toFixed(2)}`;
  const number = el("span", { class: "number" }, share.toFixed(2));
  return el("div", { class: "share", title }, el("span", { class: "bar" }, fill, tick), number);
}

/** The annotator's table: one choice for each press; `label(press, state)` sends it. */
export class Labels extends Presses {
  constructor(parent, replay, pick, label) {
    super(replay, pick);
    this.label = label;
    this.rows = replay.presses.map((press) => this.#row(press));
    const help = replay.states.map((state, i) => {
      const [name, text] = meaning(state);
      return [el("dt", {}, el("kbd", {}, String(i + 1)), ` ${name}`), el("dd", {}, text)];
    });
    this.left = el("p", { class: "left", role: "status" });
    parent.append(
      el("h2", {}, "Why did the teacher press?"),
      el("dl", { class: "states" }, ...help.flat()),
      el("table", { class: "labelling" }, el("tbody", {}, ...this.rows)),
      this.left,
    );
    this.#count();
  }

  #row(press) {
    const choices = this.replay.states.map((state) => {
      const one = { type: "radio", name: `press-${press.seq}`, value: state, checked: press.label === state };
      const radio = el("input", { ...one, onchange: () => this.#chosen(press, state) });
      return el("label", {}, radio, ` ${meaning(state)[0]}`);
    });
    const name = `Press at ${seconds(press.t, this.replay.dt)} s`;
    const group = el("div", { role: "radiogroup", "aria-label": name }, ...choices);
    const saved = el("td", { class: "saved", "aria-live": "polite" });
    return el("tr", {}, this.when(press), el("td", {}, group), saved);
  }

  #chosen(press, state) {
    this.#note(press, "…");
    press.asked = state;
    this.label(press, state);
  }

  /** The label of the press in line `seq` is on disk. */
  saved(seq) {
    const press = this.replay.presses.find((one) => one.seq === seq);
    if (!press) return;
    press.label = press.asked ?? press.label;
    this.#note(press, "saved");
    this.#count();
  }

  /** What was asked last is not on disk: back to what is. */
  failed() {
    for (const [i, press] of this.replay.presses.entries()) {
      if (press.asked === undefined || press.asked === press.label) continue;
      press.asked = undefined;
      this.#note(press, "not saved");
      for (const radio of this.rows[i].querySelectorAll("input")) radio.checked = radio.value === press.label;
    }
  }

  /** A digit labels the current press. */
  key(event) {
    const state = this.replay.states[Number(event.key) - 1];
    if (!state || this.now < 0 || this.now === undefined) return false;
    const radio = this.rows[this.now].querySelector(`input[value="${CSS.escape(state)}"]`);
    radio.checked = true;
    this.#chosen(this.replay.presses[this.now], state);
    return true;
  }

  #note(press, text) {
    this.rows[this.replay.presses.indexOf(press)].querySelector(".saved").textContent = text;
  }

  #count() {
    const all = this.replay.presses.length;
    const left = this.replay.presses.filter((press) => !press.label).length;
    const some = `${left} of ${all} presses have no label yet.`;
    this.left.textContent = left ? some : "All presses have a label.";
  }
}
