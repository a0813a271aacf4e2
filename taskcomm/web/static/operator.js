// The operator's page: the world under the mouse. Only what is valid now responds.

import { cardOf } from "./card.js";
import { el } from "./dom.js";
import { moment } from "./wire.js";
import { parsed, told, words } from "./words.js";
import { WorldView } from "./world.js";

const END = 3000; // ms that the end of a trial stays in view
const HELP = ["light", "hold", "slide", "final"];

export function start(root, wire, welcome) {
  const say = words(welcome.texts);
  const desk = new Desk(root, welcome, { say, send: (message) => wire.send(message) });
  return {
    receive(message) {
      desk[`on_${message.type}`]?.(message);
      if (message.type === "page" && message.kind === "gone") wire.stop();
    },
    lost: () => desk.lost(),
    back: () => desk.back(),
  };
}

/** The action that a click on `target` {ball | robot | reference, distance} means; `light`: right button. */
export function meant(target, light, held, actions) {
  const wanted = (action) => {
    const { name, ball, distance, reference } = parsed(action);
    if (target.robot) return !light && name === "final";
    if (target.reference) {
      const there = distance === target.distance && reference === target.reference;
      return !light && name === "slide" && ball === held && there;
    }
    const names = light ? ["light_on", "light_off"] : ["pick_up", "release"];
    return names.includes(name) && ball === target.ball;
  };
  return actions.find(wanted) ?? null;
}

/** Which part of the picture `node` belongs to. */
function targetOf(node) {
  const data = node.closest?.("[data-ball], [data-robot], [data-reference]")?.dataset;
  if (!data) return null;
  if (data.robot) return { robot: true };
  if (data.ball) return { ball: Number(data.ball) };
  return { reference: Number(data.reference), distance: Number(data.distance) };
}

class Desk {
  constructor(root, welcome, { say, send }) {
    Object.assign(this, { say, send, seat: { state: "idle" }, t: -1, actions: [], chosen: "" });
    this.status = el("p", { class: "status", role: "status" });
    this.ready = el("button", { type: "button", class: "first", onclick: () => this.#answer() });
    this.next = el("p", { class: "next", "aria-live": "polite" });
    this.card = el("div");
    this.help = el("ul", { class: "help" }, HELP.map((key) => el("li", {}, say(`operator_help_${key}`))));
    const title = el("h1", {}, say("operator_title"));
    const name = el("p", { class: "progress" }, welcome.name);
    const parts = [title, name, this.status, this.ready, this.next, this.card, this.help];
    const side = el("div", { class: "side" }, parts);
    this.stage = el("div", { class: "stage" });
    this.told = el("p", { class: "told", "aria-live": "polite" });
    this.section = el("section", { class: "operator" }, side, this.stage, this.told);
    root.replaceChildren(this.section);
    this.stage.addEventListener("contextmenu", (event) => event.preventDefault());
    this.stage.addEventListener("mousedown", (event) => this.#clicked(event));
    this.#draw();
  }

  on_seat(seat) {
    const fresh = seat.state !== this.seat.state || seat.participant !== this.seat.participant;
    this.seat = seat;
    if (fresh && ["idle", "ask", "wait"].includes(seat.state)) {
      setTimeout(() => seat === this.seat && this.#clear(), this.frame?.state === "over" ? END : 0);
    }
    this.#draw();
  }

  on_frame(frame) {
    this.view ??= new WorldView(this.stage, { say: this.say });
    this.view.show(frame);
    this.frame = frame;
    this.told.textContent = told(this.say, frame) || this.told.textContent;
    if (frame.t !== this.t || frame.state === "over") this.#offer(frame.t, [], "");
    else this.#marked();
  }

  on_choices({ t, actions, chosen }) {
    this.#offer(t, actions, chosen);
  }

  on_pressed() {
    this.view?.press();
  }

  on_page({ kind }) {
    if (kind !== "gone") return;
    this.#clear();
    this.section.replaceChildren(el("p", { class: "status", role: "status" }, this.say("page_gone")));
  }

  lost() {
    this.#offer(this.t, [], "");
    this.ready.disabled = true;
  }

  back() {
    this.ready.disabled = false;
  }

  #clear() {
    this.stage.replaceChildren();
    this.told.textContent = "";
    this.view = this.frame = null;
    this.#offer(-1, [], "");
  }

  /** From now on `actions` respond, for the step after `t`. */
  #offer(t, actions, chosen) {
    Object.assign(this, { t, actions, chosen });
    this.#marked();
  }

  #clicked(event) {
    const light = event.button === 2 || (event.button === 0 && event.ctrlKey);
    const target = targetOf(event.target);
    if (!target || event.button === 1) return;
    event.preventDefault();
    const action = meant(target, light, this.frame?.held, this.actions);
    if (!action) return;
    const sent = this.send({ type: "act", t: this.t, action, at: moment(event.timeStamp) });
    if (sent) this.#offer(this.t, this.actions, action);
  }

  /** Shows on the picture what responds, and what was chosen. */
  #marked() {
    for (const node of this.stage.querySelectorAll("[data-ball], [data-robot], [data-reference]")) {
      const target = targetOf(node);
      const left = meant(target, false, this.frame?.held, this.actions);
      const right = meant(target, true, this.frame?.held, this.actions);
      node.classList.toggle("responds", Boolean(left || right));
      node.classList.toggle("chosen", this.chosen !== "" && [left, right].includes(this.chosen));
    }
    const { name, ...places } = parsed(this.chosen);
    const action = name ? this.say(`act_${name}`, places) : "";
    const text = action ? this.say("operator_chosen", { action }) : this.say("operator_nothing");
    this.next.textContent = this.seat.state === "control" ? text : "";
    this.next.classList.toggle("set", Boolean(action));
  }

  #answer() {
    this.send({ type: "ready", on: this.seat.state === "ask" });
  }

  #draw() {
    const { state, participant, card = [] } = this.seat;
    this.status.textContent = this.say(`operator_${state}`);
    this.section.dataset.state = state;
    this.section.dataset.participant = participant ?? "";
    this.ready.hidden = !["ask", "wait"].includes(state);
    this.ready.textContent = this.say(state === "wait" ? "operator_not_ready" : "operator_ready");
    this.ready.className = state === "wait" ? "second" : "first";
    this.help.hidden = state === "watch";
    const [mov, wrt, dist] = card;
    const sentence = mov && this.say("card_picture", { mov, wrt, dist });
    const picture = () => cardOf({ mov, wrt, dist, sentence }, this.say, this.say("trial_card"));
    this.card.replaceChildren(...(mov ? [picture()] : []));
    this.#marked();
  }
}
