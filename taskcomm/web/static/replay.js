// Logged trials again: the list, and a player with the world, the belief, the reasons or the labels.

import { Charts } from "./charts.js";
import { el } from "./dom.js";
import { arrange } from "./layout.js";
import { Labels, Reasons } from "./reasons.js";
import { TimeBar } from "./timebar.js";
import { button, sheet } from "./tools.js";
import { TrialList, ending } from "./triallist.js";
import { told, words } from "./words.js";
import { WorldView } from "./world.js";

const KEYS = "Keys: space plays; arrows go a step; n and p go from press to press; b plays what led here";
const say = words();
const WALKS = /^(Arrow|Page|Home|End)/;

/** Whether the key belongs to the control that has the focus. */
function taken({ target, key }) {
  if (target.tagName === "BUTTON") return key === " " || key === "Enter";
  if (target.type === "range") return WALKS.test(key);
  if (target.type === "radio") return WALKS.test(key) || key === " ";
  return /^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName);
}

/** The view of an annotator; main.js calls it. */
export function start(root, wire, welcome) {
  root.lang = "en";
  root.classList.add("tool");
  const who = el("p", { class: "facts" }, `Annotator ${welcome.name}`);
  const heading = el("header", { class: "head" }, el("h1", {}, welcome.title), who);
  const place = el("section", { "aria-label": "Trials" });
  root.append(heading, place);
  return new Replays(place, wire, false);
}

/** The list of trials, and the one that is open. An admin (`full`) sees beliefs and may choose a model. */
export class Replays {
  constructor(parent, wire, full) {
    Object.assign(this, { wire, full });
    sheet("replay.css");
    this.problem = el("p", { class: "problem", role: "alert" });
    this.listing = el("div");
    this.playing = el("div");
    parent.append(this.problem, this.listing, this.playing);
    this.list = new TrialList(this.listing, full, (trial) => this.open(trial));
    this.models = [];
    document.addEventListener("keydown", (event) => this.#key(event));
    this.back();
  }

  /** The connection is there (again): the list is fetched anew. */
  back() {
    this.wire.send({ type: "list" });
  }

  /** Asks for a trial, under a model or, without one, under the robot's own. */
  open(trial, model = null) {
    this.#tell("");
    this.asked = trial;
    this.wire.send({ type: "open", trial, model });
  }

  /** What the server says of trials. */
  receive(message) {
    if (message.type === "trials") {
      this.models = message.models;
      this.list.show(message.trials);
    } else if (message.type === "replay" && message.trial === this.asked) this.#show(message);
    else if (message.type === "ack" && message.what === "label") this.player?.labels?.saved(message.n);
    else if (message.type === "problem") {
      this.#tell(message.text);
      this.player?.labels?.failed();
    }
  }

  lost() {
    this.player?.time.pause();
  }

  #show(replay) {
    const at = this.player?.replay.trial === replay.trial ? this.player.time.at : 0;
    this.close(false);
    this.listing.hidden = true;
    this.player = new Player(this.playing, replay, {
      models: this.models,
      close: () => this.close(),
      choose: (model) => this.open(replay.trial, model),
      label: (press, state) => this.#label(replay, press, state),
    });
    this.player.time.go(at);
  }

  #label(replay, press, state) {
    this.#tell("");
    const said = { trial: replay.trial, press_seq: press.seq, mental_state: state };
    const sent = this.wire.send({ type: "label", ...said });
    if (!sent) {
      this.#tell("The connection is lost; this label was not saved.");
      this.player.labels.failed();
    }
  }

  /** Back to the list. */
  close(listed = true) {
    this.player?.time.pause();
    this.player = null;
    this.playing.replaceChildren();
    this.listing.hidden = false;
    if (listed) this.back();
  }

  #tell(text) {
    this.problem.textContent = text;
  }

  #key(event) {
    if (!this.player || !this.playing.isConnected || this.playing.offsetParent === null) return;
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    if (!taken(event) && this.player.key(event)) event.preventDefault();
  }
}

/** One trial: what was shown, and what may be known of it. */
class Player {
  constructor(parent, replay, { models, close, choose, label }) {
    this.replay = replay;
    this.presses = new Set(replay.presses.map((press) => press.t));
    const [world, right, below] = ["view", "right", "below"].map((name) => el("div", { class: name }));
    const bar = el("div");
    this.line = el("p", { class: "now" });
    const badge = replay.source === "simulated" ? el("span", { class: "badge" }, "simulated") : "";
    const title = el("h1", {}, `Trial ${replay.trial}`, badge);
    const known = el("p", { class: "facts" }, facts(replay));
    const model = replay.belief ? modelChoice(models, replay.belief.model, choose) : null;
    parent.append(
      el("div", { class: "head" }, button("All trials", close), title, known, model),
      el("div", { class: replay.belief ? "player" : "player blind" }, world, right),
      bar,
      this.line,
      below,
    );
    this.world = new WorldView(world, { say });
    this.world.show(replay.frames[0]);
    this.layouts = [];
    for (const frame of replay.frames) this.layouts.push(arrange(frame, this.layouts.at(-1) ?? null));
    this.time = new TimeBar(bar, {
      count: replay.frames.length,
      dt: replay.dt,
      jumps: replay.presses.map((press) => press.t + 1),
      time: (at) => this.#seconds(at),
      moved: (at, played) => this.#show(at, played),
      told: (at) => this.#words(at),
    });
    const pick = (t) => this.time.go(t + 1);
    if (replay.belief) {
      this.charts = new Charts(right, { ...replay, pick: (at) => this.time.go(at) });
      for (const note of replay.about.notes) right.append(el("p", { class: "note" }, note));
      if (replay.reasons.length) this.table = new Reasons(below, replay, pick);
    } else if (replay.presses.length) this.table = this.labels = new Labels(right, replay, pick, label);
    else right.append(el("p", {}, "There is no press in this trial: nothing to label."));
    const keys = this.labels ? `${KEYS}; digits label the marked press.` : `${KEYS}.`;
    parent.append(el("p", { class: "help" }, keys));
  }

  key(event) {
    return Boolean(this.labels?.key(event)) || this.time.key(event);
  }

  #show(at, played) {
    const frame = this.replay.frames[at];
    if (at > 0) this.world.layout = this.layouts[at - 1]; // as if all before had been shown
    this.world.show(frame, { animate: played });
    if (this.presses.has(frame.t)) this.world.press();
    else if (!played) this.world.svg.classList.remove("pressed"); // that of where we come from
    this.charts?.show(at);
    this.table?.show(frame.t);
    this.line.setAttribute("aria-live", played ? "off" : "polite");
    this.line.textContent = this.#words(at);
  }

  /** The end of the step at position `at`; Final takes no time. */
  #seconds(at) {
    const { frames, dt } = this.replay;
    const final = frames.at(-1).final.length > 0;
    return Math.min(at, frames.length - (final ? 2 : 1)) * dt;
  }

  /** The state at position `at` in words. */
  #words(at) {
    const { frames, belief } = this.replay;
    const frame = frames[at];
    const when = frame.t < 0 ? "Before the first step." : `${this.#seconds(at).toFixed(1)} s.`;
    const done = told(say, frame) || (frame.t < 0 ? "" : "The robot does nothing.");
    const pressed = this.presses.has(frame.t) ? "The teacher presses." : "";
    const believed = belief ? this.#believed(Math.min(at, belief.time.length - 1)) : "";
    return [when, done, pressed, believed].filter(Boolean).join(" ");
  }

  #believed(at) {
    const { belief } = this.replay;
    const entropy = belief.entropy[at].toFixed(2);
    const [mov, wrt, dist] = belief.likeliest[at];
    const task = say("card_picture", { mov, wrt, dist }).toLowerCase();
    return `Likeliest: ${task}, with ${belief.highest[at].toFixed(2)}; entropy ${entropy} nats.`;
  }
}

function modelChoice(models, now, choose) {
  const options = models.map((name) => el("option", { value: name, selected: name === now }, name));
  const select = el("select", { onchange: () => choose(select.value) }, ...options);
  return el("label", { class: "model" }, "Belief under the model ", select);
}

/** What is known of a trial, in a line. An annotator's says nothing of conditions. */
function facts({ about, card, frames, presses }) {
  const [mov, wrt, dist] = card;
  const asked = say("card_picture", { mov, wrt, dist }).toLowerCase();
  const task = card.length ? `card: ${asked}` : "card unknown";
  if (!about.trial) return `${task} · ${presses.length} presses`;
  const said = [
    `participant ${about.participant ?? "unknown"}`,
    `condition ${about.condition}`,
    task,
    `${about.steps} steps, ${presses.length} presses`,
    ending(about),
    about.lost ? `key not recorded in ${about.lost} steps` : "",
    about.defaults ? `${about.defaults} default actions` : "",
  ];
  return said.filter(Boolean).join(" · ");
}
