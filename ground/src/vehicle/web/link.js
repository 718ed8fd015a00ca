// The connection to the program: one WebSocket, on which everything comes and every order goes.

/** Between two attempts to connect, ms. */
const AGAIN = 500;
/** Silence after which the connection counts as broken, ms. */
const SILENCE = 2000;
/** The program's close codes: the token is not of this start; too many pages are open. */
const REFUSED = {
  4403: "This page is of another start of tvc web: open the address that it printed. STOP still works.",
  4503: "Too many pages are open: close one. STOP still works.",
};

/** What vehicle and tool say of a command of the tool, for somebody who has the page's buttons. */
export const forPage = (words) => words.replace(/(run )?tvc calibrate polarity/, "press Check polarity");

export class Link {
  /** `show` gets whatever comes; `begin` is called when the program sends everything anew. */
  constructor(token, begin, show) {
    Object.assign(this, { token, begin, show, now: null, refusal: "", waiting: new Map(), next: 1 });
    this.connect();
    setInterval(() => {
      if (this.isSilent()) this.lose(this.socket);
    }, AGAIN);
  }

  connect() {
    const socket = new WebSocket(`ws://${location.host}/page`);
    this.socket = socket;
    this.heard = performance.now();
    socket.addEventListener("open", () => socket.send(JSON.stringify({ token: this.token })));
    socket.addEventListener("message", (event) => {
      if (socket === this.socket) this.take(JSON.parse(event.data));
    });
    socket.addEventListener("close", (event) => this.lose(socket, event.code));
  }

  take(news) {
    this.heard = performance.now();
    if ("id" in news) {
      this.waiting.get(news.id)?.(news);
      this.waiting.delete(news.id);
      return;
    }
    if ("token" in news) {
      // The address had a word in place of the token, which was good for one connection only.
      this.token = news.token;
      history.replaceState(null, "", `#token=${news.token}`);
      return;
    }
    if (this.now === null) this.begin();
    this.refusal = "";
    this.now = news.now_ms;
    this.show(news);
  }

  isSilent() { return this.socket !== null && performance.now() - this.heard > SILENCE; }

  /** The connection is gone; another one follows. */
  lose(socket, code) {
    if (socket !== this.socket) return;
    this.socket = null;
    this.now = null;
    socket.close();
    for (const tell of this.waiting.values()) tell({ error: "the connection to tvc web broke" });
    this.waiting.clear();
    this.refusal = REFUSED[code] ?? "";
    setTimeout(() => this.connect(), AGAIN);
  }

  /** Sends an order; gives what became of it: `error`, or perhaps a `note`. */
  order(order, fields = {}) {
    if (this.now === null) return Promise.resolve({ error: "tvc web does not answer: is it still running?" });
    const id = this.next;
    this.next += 1;
    this.socket.send(JSON.stringify({ id, heard_ms: this.now, order, ...fields }));
    return new Promise((tell) => this.waiting.set(id, tell));
  }
}
