// Where everything of a frame is drawn: a pure function of the frame (and of the layout before, so that what
// need not move stays). World units, y downwards, the robot at (0, 0).
//
// Balls stand on a circle round the robot. Each other ball has a ray for the held one, with its distances as
// marks; a placed ball stands on the ray that it was slid along. A ray points to the home of the ball that
// slides along it, turned as little as lets it clear of everything else.

const TURNS = Array.from({ length: 145 }, (_, i) => ((i % 2 ? 1 : -1) * Math.ceil(i / 2) * Math.PI) / 72);
const RADIUS = { 2: 64, 3: 64, 4: 54, 5: 46, 6: 40 };
const GAP = 5; // between two things that stand beside one another
const WIDE = 1.5; // width to height of what is seen
const FREE = 118; // half the width of the robot showing Final

/** How large everything is. `first`, `step`: distance 1, and from one to the next, centre to centre. */
export function sizes(balls, distances) {
  const radius = RADIUS[balls] ?? Math.max(12, 240 / balls);
  const mark = 0.36 * radius;
  const [first, step] = [2 * radius + 36, radius + mark + 7];
  const corners = Math.max(balls, 3);
  const side = first + step * (distances - 1) + 2 * radius + 2 * GAP;
  const home = Math.max(FREE + 2 * radius + 60, 350, side / (2 * Math.sin(Math.PI / corners)));
  return { balls, distances, radius, mark, first, step, home, free: FREE };
}

const turned = ({ x, y }, angle, far) => ({ x: x + far * Math.cos(angle), y: y + far * Math.sin(angle) });
const between = (p, q) => Math.hypot(p.x - q.x, p.y - q.y);
const towards = (p, q) => Math.atan2(q.y - p.y, q.x - p.x);

/** The home of `ball`, clockwise from the top (two balls: as three, without the top one). */
export function homeOf(ball, size) {
  const corners = Math.max(size.balls, 3);
  const first = size.balls % 2 ? -Math.PI / 2 : -Math.PI / 2 - Math.PI / corners;
  const at = size.balls === 2 ? Math.PI / 6 + (ball === 1 ? (2 * Math.PI) / 3 : 0) : null;
  return turned({ x: 0, y: 0 }, at ?? first + ((ball - 1) * 2 * Math.PI) / corners, size.home);
}

const homesOf = (size) => Array.from({ length: size.balls }, (_, i) => homeOf(i + 1, size));

/** The points of distances 1, 2, ... on the ray at `angle` from `point`. */
const ray = (point, angle, size) =>
  Array.from({ length: size.distances }, (_, k) => turned(point, angle, size.first + k * size.step));

/** What is seen of the world at least: all homes with some margin, and as wide as screens are. */
function box(size) {
  const bounds = around([...homesOf(size), { x: 0, y: 0 }], size.radius + 34);
  const wide = (WIDE * (bounds.bottom - bounds.top)) / 2;
  return { ...bounds, left: Math.min(bounds.left, -wide), right: Math.max(bounds.right, wide) };
}

function around(points, margin) {
  const [xs, ys] = [points.map((p) => p.x), points.map((p) => p.y)];
  const [left, top] = [Math.min(...xs) - margin, Math.min(...ys) - margin];
  return { left, top, right: Math.max(...xs) + margin, bottom: Math.max(...ys) + margin };
}

/** How much of a circle round `point` stands out of `bounds`. */
const outside = (point, bounds, radius) =>
  Math.max(0, bounds.left - point.x + radius, point.x + radius - bounds.right) +
  Math.max(0, bounds.top - point.y + radius, point.y + radius - bounds.bottom);

/** How far a ball at `point` reaches into the `others` or into the room kept for the robot; 0: into none. */
const into = (point, others, size) =>
  Math.max(0, ...others.map((other) => 2 * size.radius + GAP - between(point, other))) +
  Math.max(0, size.radius + GAP + size.free - Math.hypot(point.x, point.y));

/**
 * The angle of the ray of `ball` at `reference`, clear of the balls `at` their points, of homes, and `apart`
 * from the points to `avoid`, in that order of weight. The angle `kept` from before stays while no ball is in
 * its way; where the ball stands at a distance, `only` that point of the ray matters for this.
 */
function aimed(ball, reference, { at, kept, avoid, apart, bounds, size, only }) {
  const start = at.get(reference);
  const wanted = towards(start, homeOf(ball, size));
  const others = [...at].filter(([other]) => other !== ball).map(([, point]) => point);
  if (kept !== undefined) {
    const points = ray(start, kept, size).filter((_, k) => !only || k + 1 === only);
    if (points.every((point) => into(point, others, size) === 0)) return kept;
  }
  const homes = homesOf(size).filter((_, i) => i + 1 !== ball);
  const here = at.has(ball) ? [at.get(ball)] : []; // no mark is hidden by the ball where it is
  const worst = (points, measure) => Math.max(0, ...points.map(measure));
  const hidden = (p) => worst(here, (q) => size.radius + size.mark + GAP - between(p, q));
  const cost = (turn) => {
    const points = ray(start, wanted + turn, size);
    const crossed = worst(points, (p) => worst(avoid, (q) => apart + GAP - between(p, q)));
    return (
      Math.abs(turn) +
      50 * worst(points, (point) => into(point, others, size)) +
      10 * worst(points, hidden) +
      3 * worst(points, (point) => into(point, homes, size)) +
      crossed +
      0.02 * worst(points, (point) => outside(point, bounds, size.radius))
    );
  };
  const costs = TURNS.map(cost);
  return wanted + TURNS[costs.indexOf(Math.min(...costs))];
}

/** The placements with every reference before what stands at it; then by number of the ball. */
function inOrder(placements) {
  const reference = new Map(placements.map(([ball, other]) => [ball, other]));
  const depth = (ball) => (reference.has(ball) ? 1 + depth(reference.get(ball)) : 0);
  return [...placements].sort((a, b) => depth(a[0]) - depth(b[0]) || a[0] - b[0]);
}

/**
 * Positions of everything in `frame`: {size, at: ball -> {x, y}, placed: [{ball, reference, distance}],
 * rays: [{reference, points}] while a ball is held, view: {left, top, right, bottom}, angles}.
 * `before` is the layout of the frame before, or null.
 */
export function arrange(frame, before = null) {
  const size = sizes(frame.balls, frame.distances);
  const bounds = box(size);
  const same = before?.size.balls === size.balls && before.size.distances === size.distances;
  const kept = (ball, reference) => (same ? before.angles.get(`${ball}/${reference}`) : undefined);
  const [at, angles, avoid] = [new Map(), new Map(), []];
  const placements = inOrder(frame.placements);
  const placedBalls = new Set(placements.map(([ball]) => ball));
  for (let ball = 1; ball <= size.balls; ball += 1) {
    if (!placedBalls.has(ball)) at.set(ball, homeOf(ball, size));
  }
  for (const [ball, reference, distance] of placements) {
    const old = kept(ball, reference);
    const only = frame.held === ball ? 0 : distance;
    const known = { at, avoid, apart: 2 * size.radius, bounds, size };
    const angle = aimed(ball, reference, { ...known, kept: old, only });
    angles.set(`${ball}/${reference}`, angle);
    const points = ray(at.get(reference), angle, size);
    avoid.push(...points);
    at.set(ball, points[distance - 1]);
  }
  const rays = frame.held ? raysOf(frame.held, { at, angles, kept, bounds, size }) : [];
  const placed = placements.map(([ball, reference, distance]) => ({ ball, reference, distance }));
  const view = around([...at.values(), ...rays.flatMap((one) => one.points)], size.radius + 12);
  return { size, at, placed, rays, angles, view: united(bounds, view) };
}

/** The ray of every other ball for the `held` one; a second round lets the first rays see the last. */
function raysOf(held, { at, angles, kept, bounds, size }) {
  const references = Array.from({ length: size.balls }, (_, i) => i + 1).filter((ball) => ball !== held);
  const stands = references.find((reference) => angles.has(`${held}/${reference}`));
  const points = new Map();
  const put = (reference, angle) => {
    angles.set(`${held}/${reference}`, angle);
    points.set(reference, ray(at.get(reference), angle, size));
  };
  if (stands) put(stands, angles.get(`${held}/${stands}`));
  for (const round of [1, 2]) {
    for (const reference of references.filter((one) => one !== stands)) {
      const avoid = references.filter((one) => one !== reference).flatMap((one) => points.get(one) ?? []);
      const before = round === 1 ? kept(held, reference) : angles.get(`${held}/${reference}`);
      const settled = before !== undefined && !crosses(points.get(reference), avoid, size);
      const known = { at, avoid, apart: size.radius + size.mark, bounds, size, only: 0 };
      put(reference, aimed(held, reference, { ...known, kept: settled ? before : undefined }));
    }
  }
  return references.map((reference) => ({ reference, points: points.get(reference) }));
}

const crosses = (points = [], others, size) =>
  points.some((p) => others.some((q) => between(p, q) < size.radius + size.mark));

const united = (a, b) => ({
  left: Math.min(a.left, b.left),
  top: Math.min(a.top, b.top),
  right: Math.max(a.right, b.right),
  bottom: Math.max(a.bottom, b.bottom),
});
