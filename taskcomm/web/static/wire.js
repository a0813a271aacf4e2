// The WebSocket: hello first, pings answered at once, opened again with growing waits when it breaks.

const FIRST_WAIT = 250;
const LONGEST_WAIT = 4000;
const SILENCE = 5000; // ms without a word of a server that pings: the connection is dead, whatever it says
const [REPLACED, REFUSED] = [4000, 4003]; // the server's close codes: another tab took over; not welcome

/** Milliseconds since 1970 of an event's timeStamp (or of now), by a clock that is never set. */
export const moment = (stamp = performance.now()) => performance.timeOrigin + stamp;

/**
 * Keeps a connection. `hear(message)` gets every message but pings; `lost()` is called when an open
 * connection breaks, `refused()` when the token is not welcome. After a break the server says anew what there
 * is to say.
 */
export class Wire {
  constructor(token, { hear, lost, refused }) {
    Object.assign(this, { token, hear, lost, refused });
    this.wait = FIRST_WAIT;
    this.#open();
    setInterval(() => this.#listen(), 500);
  }

  /** Whether messages get through now. */
  get open() {
    return Boolean(this.welcomed) && this.socket?.readyState === WebSocket.OPEN;
  }

  /** Sends `message`; false, and nothing sent or kept, where the connection is broken. */
  send(message) {
    if (!this.open) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  /** No further attempts. */
  stop() {
    this.stopped = true;
  }

  #open() {
    this.welcomed = false;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`);
    this.socket = socket;
    this.pinged = null; // when the server was last heard, once it has pinged
    const mine = (then) => (event) => socket === this.socket && then(event);
    socket.addEventListener("open", () => socket.send(JSON.stringify({ type: "hello", token: this.token })));
    socket.addEventListener("message", mine((event) => this.#heard(JSON.parse(event.data))));
    socket.addEventListener("close", mine((event) => this.#closed(event.code)));
  }

  /** Gives up a connection over which nothing comes any more. */
  #listen() {
    if (this.pinged === null || performance.now() - this.pinged < SILENCE) return;
    const dead = this.socket;
    this.socket = null;
    this.pinged = null;
    dead.close();
    this.#closed(0);
  }

  #heard(message) {
    if (this.pinged !== null || message.type === "ping") this.pinged = performance.now();
    if (message.type === "ping") {
      this.send({ type: "pong", n: message.n, at: moment() });
      return;
    }
    if (message.type === "welcome") {
      this.welcomed = true;
      this.wait = FIRST_WAIT;
    }
    this.hear(message);
  }

  #closed(code) {
    const welcomed = this.welcomed;
    this.welcomed = false;
    this.pinged = null;
    if (code === REFUSED && !welcomed) {
      this.stop();
      this.refused();
    }
    if (this.stopped || code === REPLACED) return;
    if (welcomed) this.lost();
    setTimeout(() => this.#open(), this.wait * (0.75 + Math.random() / 2));
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
  }
}
