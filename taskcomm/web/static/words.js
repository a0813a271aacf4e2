// The words of the interface: English by default, the study's own where `welcome.texts` has them.

export const DEFAULTS = {
  // What the robot just did, and how things stand, for the line under the world and for screen readers.
  did_light_on: "The robot lights ball {ball}.",
  did_light_off: "The robot turns off the light of ball {ball}.",
  did_pick_up: "The robot picks up ball {ball}.",
  did_release: "The robot puts ball {ball} down.",
  did_slide: "The robot slides ball {ball} to distance {distance} from ball {reference}.",
  did_final: "The robot shows Final: ball {ball} is at distance {distance} from ball {reference}.",
  state_ball: "Ball {ball}: {state}.",
  state_lit: "lit",
  state_held: "held by the robot",
  state_placed: "at distance {distance} from ball {reference}",
  state_home: "at its place",
  state_free: "The robot holds no ball.",
  final: "Final",
  // The teacher's trial.
  trial_card: "Your card",
  trial_hint: "Spacebar: “yes, I approve”",
  trial_ready: "Get ready …",
  trial_paused: "Paused. Please wait; it goes on by itself.",
  trial_over: "This trial is over.",
  trial_focus_lost: "The keyboard is elsewhere. Click anywhere on this page.",
  trial_connection_lost:
    "Connection lost. The robot goes on by itself; presses do not count until this message goes away.",
  card_picture: "Ball {mov} at distance {dist} from ball {wrt}",
  // Pages and forms.
  page_next: "Continue",
  page_begin: "Begin",
  page_agree: "I agree",
  page_decline: "I do not agree",
  page_send: "Send",
  page_sending: "Sending …",
  page_wait: "The robot is not ready yet. Please wait.",
  page_thanks: "Thank you. You may close this page.",
  page_gone: "This page was opened in another window. You can close this one.",
  page_progress: "Page {page} of {pages}",
  form_missing: "Please answer this question.",
  form_whole: "Please enter a whole number from {low} to {high}.",
  form_optional: "(optional)",
  form_mend: "Please look again at the answers that are marked.",
  // Connection.
  link_missing: "This page needs the whole link that you were given.",
  link_refused: "This link is not valid here. Please ask the person who gave it to you.",
  connection_opening: "Connecting …",
  connection_lost: "Connection lost. Trying again …",
  // The operator.
  operator_title: "You control the robot",
  operator_idle: "No teacher is here yet. Please wait.",
  operator_ask: "Are you ready for the next trial?",
  operator_ready: "I am ready",
  operator_not_ready: "Not ready after all",
  operator_wait: "Ready. The teacher is still reading.",
  operator_watch: "The robot acts by itself in this trial. Please stay, and look on.",
  operator_control: "The robot is yours.",
  operator_chosen: "Next: {action}",
  operator_nothing: "Next: nothing",
  operator_help_light: "Right click on a ball: light on or off",
  operator_help_hold: "Left click on a ball: pick up or put down",
  operator_help_slide: "Left click on a distance, while a ball is held: slide it there, one step at a time",
  operator_help_final: "Left click on the robot: show Final, where a ball is placed",
  act_light_on: "light ball {ball}",
  act_light_off: "light of ball {ball} off",
  act_pick_up: "pick up ball {ball}",
  act_release: "put ball {ball} down",
  act_slide: "slide ball {ball} to distance {distance} from ball {reference}",
  act_final: "show Final",
  act_noa: "nothing",
};

/** A function `say(key, places)`: the text of `key`, its {places} filled in. Throws for an unknown key. */
export function words(texts = {}) {
  return function say(key, places = {}) {
    const text = texts[key] ?? DEFAULTS[key];
    if (text === undefined) throw new Error(`no words for '${key}'`);
    return text.replace(/\{(\w+)\}/g, (whole, name) => String(places[name] ?? whole));
  };
}

const PARTS = ["ball", "distance", "reference"];

/** `light_on(1)` as {name: "light_on", ball: 1}; a slide has distance and reference too. */
export function parsed(action) {
  const [name, inside = ""] = action.replace(")", "").split("(");
  const numbers = inside.split(",").filter((part) => part.trim()).map(Number);
  return { name: name.trim(), ...Object.fromEntries(numbers.map((number, i) => [PARTS[i], number])) };
}

/** What the robot did in the step of `frame`, in words; "" where it did nothing. */
export function told(say, frame) {
  if (frame.final.length) {
    const [ball, reference, distance] = frame.final;
    return say("did_final", { ball, reference, distance });
  }
  const action = parsed(frame.action);
  return action.name && action.name !== "noa" ? say(`did_${action.name}`, action) : "";
}

/** How the world of `frame` stands, ball by ball: the text alternative of its picture. */
export function described(say, frame) {
  const entry = ([ball, reference, distance]) => [ball, { reference, distance }];
  const placed = new Map(frame.placements.map(entry));
  const balls = Array.from({ length: frame.balls }, (_, i) => {
    const ball = i + 1;
    const states = [placed.has(ball) ? say("state_placed", placed.get(ball)) : say("state_home")];
    if (frame.lit.includes(ball)) states.unshift(say("state_lit"));
    if (frame.held === ball) states.unshift(say("state_held"));
    return say("state_ball", { ball, state: states.join(", ") });
  });
  return (frame.held ? balls : [...balls, say("state_free")]).join(" ");
}
