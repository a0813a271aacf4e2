// Style sheets that only some views need.

import { el } from "./dom.js";

/** Adds the style sheet `name` to the page, once. */
export function sheet(name) {
  if (!document.head.querySelector(`link[href="${name}"]`)) document.head.append(el("link", { rel: "stylesheet", href: name }));
}
