// The virtual world as a picture: figure 1 of the paper, (a) to (f).

import { set, svg } from "./dom.js";
import { arrange } from "./layout.js";
import { described } from "./words.js";

const SLIDE = 300; // ms that a ball needs to its new place
const FLASH = 500; // ms that a press is shown
const STRIP = 92; // world units below the balls, where presses are shown
const ROBOT = 62; // half the robot's side
const LAYERS = ["rays", "links", "arm", "machine", "balls", "marks", "labels", "press"];

const SIDES = ["left", "top", "right", "bottom"];

const calm = () => window.matchMedia("(prefers-reduced-motion: reduce)").matches;

/** One picture of the world in `parent`; `show` a frame, `press` draws the rectangle of a press. */
export class WorldView {
  constructor(parent, { say }) {
    this.say = say;
    this.layout = null;
    this.now = new Map(); // ball -> the point where it is drawn
    this.layers = Object.fromEntries(LAYERS.map((name) => [name, svg("g", { class: name })]));
    this.svg = svg("svg", { class: "world", role: "img", focusable: "false" }, ...Object.values(this.layers));
    parent.append(this.svg);
  }

  /** Shows `frame`; balls glide to their places unless `animate` is false or motion is not wanted. */
  show(frame, { animate = true } = {}) {
    const before = this.layout;
    this.layout = arrange(frame, before);
    if (before?.size.balls !== frame.balls || before?.size.distances !== frame.distances) this.#begin();
    this.frame = frame;
    set(this.svg, { "aria-label": described(this.say, frame), "data-t": frame.t });
    this.#marks();
    this.#robot();
    this.#states();
    this.#glide(animate && before !== null && !calm() && !document.hidden);
  }

  /** A press: the rectangle, for half a second from now. */
  press() {
    clearTimeout(this.flash);
    this.svg.classList.add("pressed");
    this.flash = setTimeout(() => this.svg.classList.remove("pressed"), FLASH);
  }

  /** What stands still in a world of this size. */
  #begin() {
    const { size } = this.layout;
    this.now.clear();
    this.seen = null;
    this.balls = new Map();
    this.layers.balls.replaceChildren();
    for (let ball = 1; ball <= size.balls; ball += 1) {
      const node = ballPicture(ball, size.radius);
      this.balls.set(ball, node);
      this.layers.balls.append(node);
    }
    this.arm = svg("line", { class: "rod" });
    this.layers.arm.replaceChildren(this.arm);
    this.press_ = svg("rect", { class: "flash", rx: 8 });
    this.layers.press.replaceChildren(this.press_);
  }

  /** The distances from every other ball while one is held, but for the one where it stands. */
  #marks() {
    const { rays, at, placed, size } = this.layout;
    const stands = placed.find(({ ball }) => ball === this.frame.held);
    const here = (reference, distance) => stands?.reference === reference && stands.distance === distance;
    const line = ({ reference, points }) => lineBetween(at.get(reference), points.at(-1));
    const marks = ({ reference, points }) =>
      points
        .map((point, k) => [reference, k + 1, point])
        .filter(([, distance]) => !here(reference, distance))
        .map(([, distance, point]) => markPicture(reference, distance, point, size.mark));
    this.layers.rays.replaceChildren(...rays.map(line));
    this.layers.marks.replaceChildren(...rays.flatMap(marks));
  }

  #robot() {
    const { final, count, state } = this.frame;
    const text = final.length ? this.say("final") : count > 0 && state !== "over" ? String(count) : "";
    this.layers.machine.replaceChildren(robotPicture(text, final.length > 0));
  }

  #states() {
    const { lit, held } = this.frame;
    for (const [ball, node] of this.balls) {
      node.classList.toggle("lit", lit.includes(ball));
      node.classList.toggle("held", held === ball);
    }
    this.svg.classList.toggle("final", this.frame.final.length > 0);
  }

  #look(view) {
    this.seen = view;
    const { left, top, right, bottom } = view;
    set(this.svg, { viewBox: `${left} ${top} ${right - left} ${bottom - top + STRIP}` });
    const width = 420;
    set(this.press_, { x: (left + right - width) / 2, y: bottom + 22, width, height: STRIP - 40 });
  }

  /** From where the balls are drawn now, and from what is seen now, to where the layout has them. */
  #glide(moving) {
    const [from, start] = [new Map(this.now), performance.now()];
    const { at: to, view } = this.layout;
    const seen = this.seen ?? view;
    cancelAnimationFrame(this.next);
    const draw = (part) => {
      const between = (side) => seen[side] + (view[side] - seen[side]) * part;
      this.#look(Object.fromEntries(SIDES.map((side) => [side, between(side)])));
      for (const [ball, end] of to) {
        const begin = from.get(ball) ?? end;
        this.now.set(ball, { x: begin.x + (end.x - begin.x) * part, y: begin.y + (end.y - begin.y) * part });
      }
      this.#draw();
    };
    const tick = (time) => {
      const part = Math.min(1, Math.max(0, (time - start) / SLIDE));
      draw(part * part * (3 - 2 * part));
      if (part < 1) this.next = requestAnimationFrame(tick);
    };
    const moves = [...to].some(([ball, end]) => far(this.now.get(ball), end) > 0.5);
    const looks = SIDES.some((side) => seen[side] !== view[side]);
    if (moving && (moves || looks)) this.next = requestAnimationFrame(tick);
    else draw(1);
  }

  #draw() {
    const { size, placed } = this.layout;
    for (const [ball, node] of this.balls) {
      const { x, y } = this.now.get(ball);
      set(node, { transform: `translate(${x.toFixed(2)} ${y.toFixed(2)})` });
    }
    const held = this.now.get(this.frame.held);
    this.arm.classList.toggle("shown", Boolean(held));
    if (held) this.#grip(held, size.radius);
    const ends = ({ ball, reference }) => [this.now.get(reference), this.now.get(ball)];
    const beside = (one) => (one.ball === this.frame.held ? size.radius + 15 : 0);
    const label = (one) => labelPicture(...ends(one), one.distance, beside(one));
    this.layers.links.replaceChildren(...placed.map((one) => lineBetween(...ends(one))));
    this.layers.labels.replaceChildren(...placed.map(label));
  }

  /** The arm from the robot to the ball, and the grip on the ball's side that the arm comes from. */
  #grip(point, radius) {
    const angle = Math.atan2(point.y, point.x);
    const reach = Math.hypot(point.x, point.y) - radius - 14;
    set(this.arm, { x1: 0, y1: 0, x2: reach * Math.cos(angle), y2: reach * Math.sin(angle) });
    const grip = this.balls.get(this.frame.held).querySelector(".grip");
    set(grip, { transform: `rotate(${((angle * 180) / Math.PI).toFixed(2)})` });
  }
}

const far = (p, q) => (p ? Math.hypot(p.x - q.x, p.y - q.y) : Infinity);

/** A ball round (0, 0): rays (seen when lit), grip (seen when held), disc and number. */
function ballPicture(ball, radius) {
  const beams = Array.from({ length: 12 }, (_, i) => {
    const [cos, sin] = [Math.cos((i * Math.PI) / 6), Math.sin((i * Math.PI) / 6)];
    const [near, end] = [radius + 9, radius + 25];
    return svg("line", { x1: near * cos, y1: near * sin, x2: end * cos, y2: end * sin });
  });
  const wide = radius + 8;
  const [x, y] = [wide * Math.cos(2.2), wide * Math.sin(2.2)];
  const grip = svg("path", { class: "grip", d: `M ${x} ${y} A ${wide} ${wide} 0 0 1 ${x} ${-y}` });
  const number = svg("text", { class: "number", "font-size": radius * 0.95 }, String(ball));
  const disc = svg("circle", { class: "disc", r: radius });
  const light = svg("g", { class: "beams" }, ...beams);
  return svg("g", { class: "ball", "data-ball": ball }, light, grip, disc, number);
}

/** The numbered mark of a distance from a ball. */
function markPicture(reference, distance, { x, y }, radius) {
  const transform = `translate(${x} ${y})`;
  return svg(
    "g",
    { class: "mark", "data-reference": reference, "data-distance": distance, transform },
    svg("circle", { r: radius }),
    svg("text", { "font-size": radius * 1.3 }, String(distance)),
  );
}

/** The robot, a square with eyes; a `text` on a sign before it: the countdown, or Final. */
function robotPicture(text, final) {
  const box = (name, x, y, height) => svg("rect", { class: name, x, y, width: -2 * x, height, rx: 10 });
  const body = box("body", -ROBOT, -ROBOT, 2 * ROBOT);
  const eyes = [-24, 24].map((x) => svg("circle", { class: "eye", cx: x, cy: -22, r: 12 }));
  const large = final ? Math.min(74, 340 / text.length) : 46; // a longer word is written smaller
  const wide = final ? 0.31 * large * text.length + 14 : ROBOT - 14;
  const plate = final ? box("plate", -wide, -46, 92) : box("plate", -wide, 0, 52);
  const shown = svg("text", { class: "said", y: final ? 2 : 28, "font-size": large }, text);
  const sign = text ? [plate, shown] : [svg("line", { class: "mouth", x1: -22, y1: 28, x2: 22, y2: 28 })];
  return svg("g", { class: "robot", "data-robot": "1" }, body, ...eyes, ...sign);
}

const lineBetween = (p, q) => svg("line", { x1: p.x, y1: p.y, x2: q.x, y2: q.y });

/** The distance of a placed ball: amid the line to its reference, or `beside` the ball, off the robot. */
function labelPicture(from, to, distance, beside) {
  const across = Math.atan2(to.y - from.y, to.x - from.x) + Math.PI / 2;
  const side = to.x * Math.cos(across) + to.y * Math.sin(across) < 0 ? -beside : beside;
  const [x, y] = beside
    ? [to.x + side * Math.cos(across), to.y + side * Math.sin(across)]
    : [(from.x + to.x) / 2, (from.y + to.y) / 2];
  return svg(
    "g",
    { transform: `translate(${x.toFixed(2)} ${y.toFixed(2)})` },
    svg("circle", { r: 17 }),
    svg("text", { "font-size": 26 }, String(distance)),
  );
}
