// The admin's page: who is where, a look at a running trial, pause and abort, and every logged trial.

import { el, set } from "./dom.js";
import { Replays } from "./replay.js";
import { button, sheet } from "./tools.js";
import { told, words } from "./words.js";
import { WorldView } from "./world.js";

const say = words();

/** The view of an admin; main.js calls it. */
export function start(root, wire, welcome) {
  return new Admin(root, wire, welcome);
}

class Admin {
  constructor(root, wire, welcome) {
    this.wire = wire;
    this.watched = null;
    sheet("replay.css");
    sheet("admin.css");
    root.lang = "en";
    root.classList.add("tool");
    this.server = el("p", { class: "server", role: "status" });
    this.badge = el("span", { class: "badge", hidden: true }, "simulated");
    this.study = el("section", { "aria-label": "Participants" });
    this.trials = el("section", { "aria-label": "Trials", hidden: true });
    this.tabs = ["Participants", "Trials"].map((name, i) => {
      const tab = button(name, () => this.#turn(i), { class: "tab" });
      return set(tab, { "aria-pressed": i === 0 });
    });
    const heading = el("h1", {}, welcome.title, this.badge);
    root.append(
      el("header", { class: "top" }, heading, el("nav", {}, ...this.tabs), this.server),
      this.study,
      this.trials,
    );
    this.people = new People(this.study, {
      watch: (who) => this.#watch(who),
      order: (who, what) => this.#order(who, what),
      replay: (who) => this.#replays(who),
    });
    this.live = new Live(this.study, () => this.#watch(null));
    this.replays = new Replays(this.trials, wire, true);
  }

  receive(message) {
    if (message.type === "status") {
      this.people.show(message.participants, this.watched);
      this.live.know(message.participants.find((one) => one.participant === this.watched));
      this.#server(message.server);
    } else if (message.type === "frame") this.live.show(message);
    else if (message.type === "pressed") this.live.press();
    else if (message.type === "problem" && !this.study.hidden) this.people.tell(message.text);
    else this.replays.receive(message);
  }

  back() {
    this.replays.back();
    if (this.watched) this.wire.send({ type: "watch", participant: this.watched });
  }

  lost() {
    this.people.stale();
    this.replays.lost();
  }

  #turn(index) {
    this.tabs.forEach((tab, i) => tab.setAttribute("aria-pressed", String(i === index)));
    this.study.hidden = index !== 0;
    this.trials.hidden = index !== 1;
    if (index === 1) this.replays.back();
  }

  #replays(participant) {
    this.replays.close(false);
    this.replays.list.narrow(participant);
    this.#turn(1);
  }

  #watch(participant) {
    this.watched = participant;
    this.wire.send({ type: "watch", participant });
    this.live.begin(participant);
    this.people.mark(participant);
  }

  #order(participant, what) {
    this.people.tell("");
    const sent = this.wire.send({ type: "order", participant, what });
    if (!sent) this.people.tell("The connection is lost; nothing was done.");
  }

  #server({ trials, clients, late_ms: late, missed, simulated }) {
    this.badge.hidden = !simulated;
    const shown = [
      `${trials} ${trials === 1 ? "trial runs" : "trials run"}`,
      `${clients} ${clients === 1 ? "page" : "pages"} connected`,
      `latest tick ${ms(late)} late`,
      `${missed} ${missed === 1 ? "step" : "steps"} missed`,
    ];
    this.server.textContent = shown.join(" · ");
  }
}

const ms = (value) => (value === null ? "" : `${value < 10 ? value.toFixed(1) : Math.round(value)} ms`);
const STATES = { run: "running", count: "counting down", pause: "paused", over: "over" };

const running = (one) => one.t !== null && one.state !== "over";

// Name, text, and when it is worth a look.
const COLUMNS = [
  ["Connected", (one) => (one.connected ? "yes" : "no"), (one) => !one.connected && running(one)],
  ["Page", (one) => `${Math.min(one.page + 1, one.of)} of ${one.of}: ${one.kind}`],
  ["Trial", (one) => one.trial ?? ""],
  ["Condition", (one) => one.condition ?? ""],
  ["Operator", (one) => one.operator ?? ""],
  ["State", (one) => STATES[one.state] ?? one.state, (one) => one.state !== "" && !(one.state in STATES)],
  ["Step", (one) => (one.t === null || one.t < 0 ? "" : String(one.t))],
  ["Latest tick", (one) => ms(one.late_ms), (one) => one.late_ms > 50],
  ["Round trip", (one) => ms(one.rtt_ms), (one) => one.rtt_ms > 250],
  ["Key lost", (one) => (one.t === null ? "" : String(one.lost)), (one) => one.lost > 0],
  ["Defaults", (one) => (one.t === null ? "" : String(one.defaults))],
];

/** The table of participants; its rows stay, so that the focus does. */
class People {
  constructor(parent, { watch, order, replay }) {
    Object.assign(this, { watch, order, replay, rows: new Map() });
    this.problem = el("p", { class: "problem", role: "alert" });
    this.body = el("tbody");
    const names = ["Participant", ...COLUMNS.map(([name]) => name), "Running trial", "Logged trials"];
    const heads = names.map((name) => el("th", { scope: "col" }, name));
    const help =
      "Key lost: steps of the running trial whose key was not recorded." +
      " Defaults: steps without a decision in time.";
    const head = el("thead", {}, el("tr", {}, ...heads));
    parent.append(
      this.problem,
      el("div", { class: "wide" }, el("table", { class: "people" }, head, this.body)),
      el("p", { class: "help" }, help),
    );
  }

  show(participants, watched) {
    this.body.classList.remove("stale");
    for (const one of participants) {
      if (!this.rows.has(one.participant)) this.#add(one.participant);
      this.#fill(this.rows.get(one.participant), one);
    }
    this.mark(watched);
  }

  tell(text) {
    this.problem.textContent = text;
  }

  /** What is shown is not of now. */
  stale() {
    this.body.classList.add("stale");
  }

  mark(watched) {
    for (const [name, { row, watch }] of this.rows) {
      row.classList.toggle("now", name === watched);
      watch.textContent = name === watched ? "Watching" : "Watch";
    }
  }

  #add(name) {
    const cells = COLUMNS.map(() => el("td"));
    const watch = button("Watch", () => this.watch(name));
    const pause = button("Pause", () => this.order(name, pause.dataset.what));
    const abort = button("Abort …", () => this.#abort(name));
    const row = el(
      "tr",
      {},
      el("th", { scope: "row" }, name),
      ...cells,
      el("td", { class: "do" }, watch, pause, abort),
      el("td", {}, button("Replays", () => this.replay(name))),
    );
    this.rows.set(name, { row, cells, watch, pause, abort });
    this.body.append(row);
  }

  #fill({ row, cells, watch, pause, abort }, one) {
    COLUMNS.forEach(([, text, odd], i) => {
      if (cells[i].textContent !== text(one)) cells[i].textContent = text(one);
      cells[i].classList.toggle("odd", Boolean(odd?.(one)));
    });
    const runs = running(one);
    const paused = one.state === "pause";
    pause.dataset.what = paused ? "go_on" : "pause";
    pause.textContent = paused ? "Go on" : "Pause";
    watch.disabled = pause.disabled = abort.disabled = !runs;
    row.classList.toggle("runs", runs);
  }

  #abort(name) {
    const dialog = el(
      "dialog",
      { class: "tool", "aria-label": "Abort" },
      el("p", {}, `Abort the running trial of ${name}?`),
      el("p", {}, "Its log ends as “aborted”; this cannot be taken back."),
      el(
        "p",
        { class: "do" },
        button("Leave it running", () => dialog.close(""), { autofocus: true }),
        button("Abort the trial", () => dialog.close("abort"), { class: "grave" }),
      ),
    );
    dialog.addEventListener("close", () => {
      if (dialog.returnValue === "abort") this.order(name, "abort");
      dialog.remove();
    });
    document.body.append(dialog);
    dialog.showModal();
  }
}

/** The world of the trial that is watched, as its teacher sees it, and the presses. */
class Live {
  constructor(parent, leave) {
    this.title = el("h2");
    this.view = el("div", { class: "view" });
    this.line = el("p", { class: "now", "aria-live": "off" });
    this.facts = el("p", { class: "facts" });
    const head = el("div", { class: "head" }, this.title, button("Stop watching", leave), this.facts);
    this.section = el("section", { class: "live", hidden: true }, head, this.view, this.line);
    parent.append(this.section);
  }

  begin(participant) {
    this.section.hidden = !participant;
    this.title.textContent = participant ? `Watching ${participant}` : "";
    this.line.textContent = "No trial is shown yet.";
    this.view.replaceChildren();
    this.world = null;
    this.presses = 0;
  }

  show(frame) {
    if (this.section.hidden) return;
    this.world ??= new WorldView(this.view, { say });
    if (frame.t <= 0) this.presses = 0;
    this.world.show(frame);
    this.line.textContent = `Step ${Math.max(frame.t, 0)}, ${STATES[frame.state]}. ${told(say, frame)}`;
  }

  press() {
    this.presses += 1;
    this.world?.press();
  }

  know(one) {
    if (!one) return;
    const presses = `${this.presses} ${this.presses === 1 ? "press" : "presses"} seen here`;
    const said = [one.trial ?? "no trial", one.condition, presses, `key lost in ${one.lost} steps`];
    this.facts.textContent = said.filter(Boolean).join(" · ");
  }
}
