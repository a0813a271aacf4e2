// A participant's pages beside the trial itself: text, consent, form, card, wait, thanks, gone.

import { cardOf } from "./card.js";
import { el } from "./dom.js";
import { questions } from "./forms.js";

/** A page in `root`; `answer(values)` is called once for each time that its button is used. */
export class PageScreen {
  constructor(root, page, { say, answer }) {
    Object.assign(this, { page, say, answer });
    this.pending = null; // the answers sent and not yet followed by another page
    this.trouble = el("p", { class: "wrong", role: "alert" });
    this.buttons = [];
    const title = el("h1", { tabindex: "-1" }, page.content.title ?? "");
    const parts = { text: "text", consent: "consent", form: "form", card: "card" }[page.kind];
    const body = parts ? this[parts](page.content) : this.note(page);
    const progress = page.of > 1 ? say("page_progress", { page: page.index + 1, pages: page.of }) : "";
    const shown = progress && parts ? el("p", { class: "progress" }, progress) : null;
    const content = [page.content.title ? title : null, body, this.trouble, shown];
    root.replaceChildren(el("section", { class: `page page-${page.kind}` }, content));
    window.scrollTo(0, 0);
    title.focus({ preventScroll: true });
  }

  /** Whether `page` is the one that is shown. */
  shows(page) {
    return page.kind === this.page.kind && page.index === this.page.index;
  }

  /** What the server found wrong with the answers. */
  problem(text) {
    this.pending = null;
    this.trouble.textContent = text;
    for (const button of this.buttons) button.disabled = false;
  }

  /** The connection is back: answers that may not have arrived are sent again. */
  again() {
    if (this.pending) this.answer(this.pending);
  }

  text(content) {
    const go = this.#button(content.button ?? this.say("page_next"), () => ({}));
    return el("div", {}, paragraphs(content), this.#actions(go));
  }

  consent(content) {
    const agree = this.#button(content.button ?? this.say("page_agree"), () => ({ agreed: true }));
    const no = content.decline ?? this.say("page_decline");
    const decline = this.#button(no, () => ({ agreed: false }), "second");
    return el("div", {}, paragraphs(content), this.#actions(agree, decline));
  }

  form(content) {
    const { node, read } = questions(content.items, this.say);
    const send = this.#button(content.button ?? this.say("page_send"), () => {
      const { ok, values } = read();
      this.trouble.textContent = ok ? "" : this.say("form_mend");
      return ok ? values : null;
    });
    return el("div", {}, paragraphs(content), node, this.#actions(send));
  }

  card(content) {
    const begin = this.#button(content.button ?? this.say("page_begin"), () => ({}));
    const card = cardOf(content, this.say, this.say("trial_card"));
    return el("div", {}, paragraphs(content), card, this.#actions(begin));
  }

  note({ kind, content }) {
    if (content.body) return el("div", {}, paragraphs(content));
    return el("div", {}, el("p", { role: "status" }, this.say(`page_${kind}`)));
  }

  #button(text, values, kind = "first") {
    const button = el("button", { type: "button", class: kind, onclick: () => this.#send(values()) }, text);
    this.buttons.push(button);
    return button;
  }

  #actions(...buttons) {
    return el("div", { class: "actions" }, buttons);
  }

  #send(values) {
    if (!values || this.pending) return;
    this.pending = values;
    for (const button of this.buttons) button.disabled = true;
    this.answer(values);
  }
}

const paragraphs = ({ body = [] }) => body.map((text) => el("p", {}, text));
