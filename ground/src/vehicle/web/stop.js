// STOP: sent by WebSocket and by HTTP at once, and repeated until the vehicle has answered. What became of it is always told.

/** Between two repeats, ms. */
const REPEAT = 250;
/** After so long without an answer the page says so, ms. */
const LATE = 250;
/** How long what was answered stays in sight, ms. */
const SEEN = 4000;
/** Most requests by HTTP that wait for their answers. */
const MOST = 4;

export class Stop {
  /** `order` sends STOP on the WebSocket; `tell(words, kind)` shows words as `waiting`, `done` or `bad`. */
  constructor(order, tell) {
    Object.assign(this, { order, tell, press: 0, since: null, why: "", requests: 0 });
    setInterval(() => {
      if (this.since !== null) this.send();
    }, REPEAT);
  }

  pressed() {
    clearTimeout(this.end);
    if (this.since === null) {
      this.press += 1;
      this.why = "";
      this.since = performance.now();
      this.tell("STOP is sent …", "waiting");
      this.warning = setTimeout(() => this.late(), LATE);
    }
    this.send();
  }

  send() {
    const press = this.press;
    const heard = (answer) => this.answered(press, answer);
    this.order().then(heard);
    if (this.requests < MOST) this.request().then(heard);
  }

  /** By a connection of its own: the WebSocket may be broken, or of an earlier start of the program. */
  async request() {
    this.requests += 1;
    try {
      const options = { method: "POST", headers: { "X-Stop": "1" }, signal: AbortSignal.timeout(1000) };
      const response = await fetch("/stop", options);
      return await response.json();
    } catch (problem) {
      return { error: problem.name === "TimeoutError" ? "no answer so far" : "tvc web does not answer" };
    } finally {
      this.requests -= 1;
    }
  }

  /** An answer to an earlier press says nothing about this one. */
  answered(press, { error, note }) {
    if (press !== this.press || this.since === null) return;
    if (error) {
      this.why = error;
      return;
    }
    this.since = null;
    clearTimeout(this.warning);
    this.tell(note ? `STOP is answered: ${note}` : "STOP is answered: the vehicle is disarmed, the rudder at neutral", "done");
    this.end = setTimeout(() => this.tell("", "done"), SEEN);
  }

  late() {
    const why = this.why ? ` (${this.why})` : "";
    this.tell(`STOP IS NOT ANSWERED${why}. It is repeated by itself. Press again, or cut the vehicle's power.`, "bad");
    this.warning = setTimeout(() => this.late(), LATE);
  }
}
