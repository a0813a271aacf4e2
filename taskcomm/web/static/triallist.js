// The trials that can be opened, in a table that can be narrowed down.

import { el } from "./dom.js";
import { button } from "./tools.js";

/** How a trial ended, in words. */
export function ending({ reason, correct }) {
  if (reason !== "final") return reason ?? "not over";
  return correct === null ? "Final" : correct ? "Final, right" : "Final, wrong";
}

const COLUMNS = [
  ["Participant", (row) => row.participant ?? ""],
  ["Condition", (row) => row.condition, "full"],
  ["Steps", (row) => row.steps],
  ["Presses", (row) => row.presses],
  ["Labelled", (row) => `${row.labelled} of ${row.presses}`],
  ["End", ending, "full"],
  ["Key lost", (row) => row.lost, "full"],
  ["Defaults", (row) => row.defaults, "full"],
  ["Data", (row) => row.source],
];

/** Rows by trial; `open(trial)` is called for the one chosen. An admin's (`full`) tells more. */
export class TrialList {
  constructor(parent, full, open) {
    this.open = open;
    this.rows = [];
    this.columns = COLUMNS.filter(([, , only]) => full || !only);
    this.filter = el("input", { type: "search", oninput: () => this.#draw() });
    this.count = el("p", { role: "status" });
    this.body = el("tbody");
    const heads = ["Trial", ...this.columns.map(([name]) => name)];
    parent.append(
      el("h2", {}, "Trials"),
      el("label", { class: "filter" }, "Show those with ", this.filter),
      this.count,
      el(
        "table",
        { class: "trials" },
        el("thead", {}, el("tr", {}, ...heads.map((head) => el("th", { scope: "col" }, head)))),
        this.body,
      ),
    );
  }

  show(rows) {
    this.rows = rows;
    this.#draw();
  }

  /** Only rows that have `text` somewhere. */
  narrow(text) {
    this.filter.value = text;
    this.#draw();
  }

  #draw() {
    const wanted = this.filter.value.trim().toLowerCase();
    const fits = (row) => JSON.stringify(Object.values(row)).toLowerCase().includes(wanted);
    const shown = this.rows.filter(fits);
    const none = this.rows.length ? "None fits." : "No trial has been logged yet.";
    this.count.textContent = shown.length ? `${shown.length} of ${this.rows.length} trials` : none;
    this.body.replaceChildren(...shown.map((row) => this.#row(row)));
  }

  #row(row) {
    if (row.problem) {
      const said = el("td", { colspan: this.columns.length }, `cannot be read: ${row.problem}`);
      return el("tr", { class: "unread" }, el("th", { scope: "row" }, row.trial), said);
    }
    const name = button(row.trial, () => this.open(row.trial), { class: "link" });
    const done = row.labelled === row.presses && row.presses > 0;
    const cells = this.columns.map(([, text]) => el("td", {}, String(text(row))));
    return el("tr", { class: done ? "done" : "" }, el("th", { scope: "row" }, name), ...cells);
  }
}
