// The page: the token from the link, the connection, and the view of the role that the server names.

import { el } from "./dom.js";
import { Wire } from "./wire.js";
import { words } from "./words.js";

const VIEWS = {
  teacher: () => import("./teacher.js"),
  operator: () => import("./operator.js"),
  admin: () => import("./admin.js"),
  annotator: () => import("./replay.js"),
};

const root = document.getElementById("root");
const notice = document.getElementById("notice");
let wire = null;
let say = words();
let view = null;
let starting = false;
let early = []; // what came while the view was being fetched

/** One line over everything: the state of the connection; "" takes it away. */
function tell(text) {
  notice.replaceChildren(...(text ? [el("p", {}, text)] : []));
}

async function welcomed(welcome) {
  tell("");
  if (starting) {
    view?.back?.();
    return;
  }
  starting = true;
  say = words(welcome.texts);
  document.documentElement.lang = welcome.language;
  document.title = welcome.title;
  const { start } = await VIEWS[welcome.role]();
  root.replaceChildren();
  view = start(root, wire, welcome);
  for (const message of early) view.receive(message);
  early = [];
}

function hear(message) {
  if (message.type === "welcome") welcomed(message);
  else if (view) view.receive(message);
  else early.push(message);
}

function lost() {
  tell(say("connection_lost"));
  view?.lost?.();
}

const token = decodeURIComponent(location.hash.slice(1));
if (token) {
  tell(say("connection_opening"));
  wire = new Wire(token, { hear, lost, refused: () => tell(say("link_refused")) });
} else tell(say("link_missing"));
window.addEventListener("hashchange", () => location.reload());
