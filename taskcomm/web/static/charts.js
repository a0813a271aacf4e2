// The belief over a trial: P(Mov), P(WRT), P(Dist), the entropy; presses as vertical lines; a cursor.

import { set, svg } from "./dom.js";

const [WIDTH, LEFT, RIGHT] = [860, 88, 50];
const [LANE, GAP, AXIS] = [20, 16, 34];
const HEIGHTS = { entropy: 86, part: 100 };
// The palette of Okabe and Ito as far as it shows on white; dashes tell the lines apart without it.
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#a0498a", "#b87800", "#3a92c4"];
const DASHES = ["", "8 3", "2 3", "10 3 2 3", "5 2", "1 2"];
const NAMES = { mov: "Mov", wrt: "WRT", dist: "Dist", task: "Task" };

/**
 * One picture for one replay. `pick(at)` is called with the position that the pointer chooses; positions are
 * those of the belief: before the first step, then after each.
 */
export class Charts {
  constructor(parent, { belief, presses, card, pick }) {
    Object.assign(this, { belief, presses, pick });
    this.steps = belief.time.length - 1;
    const parts = Object.entries(belief.marginals);
    const rows = parts.map(([field, columns], i) => ({ field, columns, right: card[i] }));
    this.height = LANE + GAP + rows.length * (HEIGHTS.part + GAP) + HEIGHTS.entropy + AXIS;
    this.svg = svg("svg", { class: "charts", viewBox: `0 0 ${WIDTH} ${this.height}`, role: "img" });
    set(this.svg, { "aria-label": "The belief over time; the line below says where it stands." });
    let top = LANE + GAP;
    for (const row of rows) {
      this.#part(row, top);
      top += HEIGHTS.part + GAP;
    }
    this.#entropy(top);
    this.bottom = top + HEIGHTS.entropy;
    this.#axis();
    this.#presses();
    this.cursor = svg("g", { class: "cursor" }, svg("line", { y1: LANE - 6, y2: this.bottom }));
    this.svg.append(this.cursor);
    this.svg.addEventListener("pointerdown", (event) => this.#picked(event));
    this.svg.addEventListener("pointermove", (event) => event.buttons === 1 && this.#picked(event));
    parent.append(this.svg);
  }

  /** Moves the cursor. */
  show(at) {
    set(this.cursor, { transform: `translate(${this.#x(Math.min(at, this.steps))} 0)` });
  }

  #x(step) {
    return LEFT + ((WIDTH - LEFT - RIGHT) * step) / Math.max(1, this.steps);
  }

  #picked(event) {
    const box = this.svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * WIDTH;
    const step = ((x - LEFT) / (WIDTH - LEFT - RIGHT)) * this.steps;
    this.pick(Math.max(0, Math.min(this.steps, Math.round(step))));
    event.preventDefault();
  }

  #frame(top, height, name, most, ticks) {
    const y = (value) => top + height - (height * value) / most;
    const parts = ticks.map((tick) => [
      svg("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(tick), y2: y(tick) }),
      svg("text", { class: "tick left", x: LEFT - 6, y: y(tick) + 4 }, String(tick)),
    ]);
    const title = svg("text", { class: "name", x: 4, y: top + height / 2 + 5 }, name);
    this.svg.append(svg("g", {}, ...parts.flat(), title));
    return y;
  }

  #line(values, y, attributes) {
    const points = values.map((value, step) => `${this.#x(step).toFixed(1)},${y(value).toFixed(1)}`);
    this.svg.append(svg("polyline", { class: "line", points: points.join(" "), ...attributes }));
  }

  #part({ field, columns, right }, top) {
    const y = this.#frame(top, HEIGHTS.part, NAMES[field] ?? field, 1, [0, 0.5, 1]);
    const entries = Object.entries(columns);
    entries.forEach(([value, column], i) => {
      const look = { stroke: COLOURS[i % COLOURS.length], "stroke-dasharray": DASHES[i % DASHES.length] };
      this.#line(column, y, { ...look, "stroke-width": String(right) === value ? 3.2 : 1.7 });
    });
    const ends = entries.map(([value, column], i) => {
      const at = y(column.at(-1));
      return { value, i, at, y: at, known: String(right) === value };
    });
    for (const end of apart(ends, 13, top + 4, top + HEIGHTS.part + 4)) this.#end(end);
  }

  /** The value that a line is of, beside its end. */
  #end({ value, i, at, y, known }) {
    const [colour, from] = [COLOURS[i % COLOURS.length], WIDTH - RIGHT];
    const lead = svg("line", { x1: from + 1, y1: at, x2: from + 11, y2: y, stroke: colour });
    const label = svg("text", { class: "end", x: from + 14, y: y + 5 }, known ? `${value} ✓` : value);
    label.style.fill = colour;
    this.svg.append(lead, label);
  }

  #entropy(top) {
    const { entropy } = this.belief;
    const most = Math.max(0.5, Math.ceil(2 * Math.max(...entropy)) / 2);
    const y = this.#frame(top, HEIGHTS.entropy, "Entropy", most, [0, most]);
    this.svg.append(svg("text", { class: "tick", x: 4, y: top + HEIGHTS.entropy / 2 + 20 }, "nats"));
    this.#line(entropy, y, { stroke: "#222", "stroke-width": 1.8 });
  }

  #axis() {
    const seconds = this.belief.time.at(-1);
    const every = [1, 2, 5, 10, 20, 30, 60, 120, 300].find((wide) => seconds / wide <= 12) ?? 600;
    for (let time = 0; time <= seconds + 1e-9; time += every) {
      const x = this.#x((time / seconds) * this.steps || 0);
      this.svg.append(
        svg("line", { class: "grid", x1: x, x2: x, y1: this.bottom, y2: this.bottom + 5 }),
        svg("text", { class: "tick centre", x, y: this.bottom + 18 }, String(time)),
      );
    }
    const y = this.bottom + 32;
    const legend = "✓ on the card · black: presses · grey: key not recorded";
    this.svg.append(
      svg("text", { class: "tick left", x: WIDTH - RIGHT, y }, "time in seconds"),
      svg("text", { class: "tick", x: LEFT, y }, legend),
    );
  }

  #presses() {
    const lane = svg("g", { class: "presses" });
    lane.append(svg("text", { class: "name", x: 4, y: 15 }, "Presses"));
    for (const { t } of this.presses) {
      const x = this.#x(t + 1);
      lane.append(svg("line", { x1: x, x2: x, y1: LANE - 2, y2: this.bottom }));
      lane.append(svg("rect", { x: x - 4, y: 4, width: 8, height: LANE - 6, rx: 2 }));
    }
    for (const [from, to] of unseen(this.belief.pressed)) {
      const box = { x: this.#x(from), y: 4, width: this.#x(to) - this.#x(from), height: LANE - 6 };
      lane.append(svg("rect", { class: "unseen", ...box }));
    }
    this.svg.append(lane);
  }
}

/** The runs of steps, [first, behind the last], in which the key was not recorded. */
function unseen(pressed) {
  const runs = [];
  pressed.forEach((key, t) => {
    if (key !== null) return;
    if (runs.at(-1)?.[1] === t) runs.at(-1)[1] = t + 1;
    else runs.push([t, t + 1]);
  });
  return runs;
}

/** The `ends` moved along y so that neighbours are `far` apart, within low to high. */
function apart(ends, far, low, high) {
  const sorted = [...ends].sort((a, b) => a.y - b.y || a.i - b.i).map((end) => ({ ...end }));
  sorted.forEach((end, i) => {
    end.y = Math.max(end.y, i ? sorted[i - 1].y + far : low);
  });
  sorted.forEach((end, i) => {
    end.y = Math.min(end.y, high - far * (sorted.length - 1 - i));
  });
  return sorted;
}
