// A form's questions: one input each, checked before they are sent.

import { el } from "./dom.js";

/** The questions of `items`: {node, read() -> {values, ok}}; `read` marks what is missing or out of range. */
export function questions(items, say) {
  const fields = items.map((item, number) => field(item, `q${number}`, say));
  const read = () => {
    const answers = fields.map((one) => one.read());
    const wrong = answers.findIndex((answer) => answer.wrong);
    fields.forEach((one, i) => one.mark(answers[i].wrong ?? ""));
    if (wrong >= 0) fields[wrong].focus();
    const values = Object.fromEntries(items.map((item, i) => [item.item, answers[i].value]));
    return { ok: wrong < 0, values };
  };
  return { node: el("div", { class: "questions" }, fields.map((one) => one.node)), read };
}

function field(item, id, say) {
  const error = el("p", { class: "wrong", id: `${id}-wrong`, role: "alert" });
  const made = (item.kind === "scale" || item.kind === "choice" ? options : typed)(item, id, say);
  const label = [item.text, item.optional ? ` ${say("form_optional")}` : ""];
  const node =
    made.inputs.length > 1
      ? el("fieldset", { "aria-describedby": `${id}-wrong` }, el("legend", {}, ...label), made.node, error)
      : el("div", { class: "field" }, el("label", { for: id }, ...label), made.node, error);
  const mark = (text) => {
    error.textContent = text;
    node.classList.toggle("marked", text !== "");
    for (const input of made.inputs) input.setAttribute("aria-invalid", String(text !== ""));
  };
  return { node, mark, focus: () => made.inputs[0].focus(), read: () => made.read() };
}

/** A whole number or a text. */
function typed(item, id, say) {
  const whole = item.kind === "integer";
  const input = el(whole ? "input" : "textarea", {
    id,
    name: item.item,
    type: whole && "text",
    inputmode: whole && "numeric",
    autocomplete: "off",
    maxlength: whole ? 12 : (item.high ?? 2000),
    rows: !whole && 3,
    "aria-describedby": `${id}-wrong`,
  });
  const read = () => {
    const text = input.value.trim();
    if (!text) return item.optional ? { value: null } : { wrong: say("form_missing") };
    if (!whole) return { value: text };
    const value = Number(text);
    const fits = /^-?\d+$/.test(text) && value >= (item.low ?? -Infinity) && value <= (item.high ?? Infinity);
    const range = { low: item.low ?? "…", high: item.high ?? "…" };
    return fits ? { value } : { wrong: say("form_whole", range) };
  };
  return { node: input, inputs: [input], read };
}

const numbers = (low, high) =>
  Array.from({ length: high - low + 1 }, (_, i) => ({ value: low + i, text: String(low + i) }));

/** One of several: the numbers of a scale with words at its ends, or choices. */
function options(item, id, say) {
  const scale = item.kind === "scale";
  const choices = scale ? numbers(item.low, item.high) : item.choices;
  const input = (_, i) => el("input", { type: "radio", name: item.item, id: `${id}-${i}`, value: i });
  const inputs = choices.map(input);
  const label = ({ text }, i) => el("label", { for: `${id}-${i}` }, inputs[i], el("span", {}, text));
  const end = (text = "") => (scale ? el("span", { class: "end" }, text) : null);
  const all = el("div", { class: "options" }, choices.map(label));
  const parts = [end(item.low_label), all, end(item.high_label)];
  const node = el("div", { class: scale ? "scale" : "choices" }, parts);
  const read = () => {
    const chosen = inputs.findIndex((input) => input.checked);
    if (chosen >= 0) return { value: choices[chosen].value };
    return item.optional ? { value: null } : { wrong: say("form_missing") };
  };
  return { node, inputs, read };
}
