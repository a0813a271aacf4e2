// What the pages of the admin and the annotators share.

import { el } from "./dom.js";

/** Adds the style sheet `name` to the page, once. */
export function sheet(name) {
  const there = document.head.querySelector(`link[href="${name}"]`);
  if (!there) document.head.append(el("link", { rel: "stylesheet", href: name }));
}

/** A button that sends no form. */
export const button = (text, onclick, attributes = {}) =>
  el("button", { type: "button", onclick, ...attributes }, text);
