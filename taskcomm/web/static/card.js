// The card: the task in a sentence and in a small picture.

import { el, svg } from "./dom.js";

/** The card of a page's content {sentence, mov, wrt, dist, distances}, under `heading`. */
export function cardOf(content, say, heading) {
  const { mov, wrt, dist } = content;
  return el(
    "aside",
    { class: "card", "aria-label": heading },
    el("h2", {}, heading),
    picture(content, say("card_picture", { mov, wrt, dist })),
    el("p", { class: "sentence" }, content.sentence),
  );
}

/** The ball to stand still at the left, the distances as marks, the ball to move at its one. */
function picture({ mov, wrt, dist, distances = dist }, label) {
  const at = (k) => 34 + 62 + (k - 1) * 46;
  const marks = Array.from({ length: distances }, (_, i) => i + 1).filter((k) => k !== dist);
  const width = at(distances) + (dist === distances ? 34 : 20);
  const disc = (kind, x, number, radius, size) =>
    svg(
      "g",
      { class: kind },
      svg("circle", { cx: x, cy: 50, r: radius }),
      svg("text", { x, y: 50, "font-size": size }, String(number)),
    );
  return svg(
    "svg",
    { class: "cardpicture", viewBox: `0 0 ${width + 4} 100`, role: "img", "aria-label": label },
    svg("line", { x1: 34, y1: 50, x2: at(distances), y2: 50 }),
    marks.map((k) => disc("spot", at(k), k, 12, 17)),
    disc("still", 34, wrt, 25, 28),
    disc("moved", at(dist), mov, 25, 28),
    svg("text", { class: "dist", x: at(dist), y: 92, "font-size": 19 }, String(dist)),
  );
}
