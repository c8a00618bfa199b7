// The socket. When it breaks, it is opened again for a minute; the server keeps the place for as long.

const KEEP_TRYING_MS = 60_000;
const TRY_EVERY_MS = 1000;
const PING_EVERY_MS = 1000;
const REFUSED = 1008; // close codes (RFC 6455): no place for this client; asking again would not help
const ENDED = 1000;

class Connection {
  /** `on`: {open, frame, message, lost(secondsLeft), closed(sentence)}. */
  constructor(address, on) {
    this.address = address;
    this.on = on;
    this.latency = undefined; // ms to the server and back, the median of the last answers
    this.answers = [];
    this.open();
    setInterval(() => this.ping(), PING_EVERY_MS);
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  open() {
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.lostAt = undefined;
      this.on.open();
    });
    socket.addEventListener("message", ({ data }) => (typeof data === "string" ? this.read(JSON.parse(data)) : this.on.frame(decodeFrame(data))));
    socket.addEventListener("close", (event) => this.closed(event));
  }

  read(message) {
    if (message.is !== "pong") return this.on.message(message);
    this.answers.push(performance.now() - message.time);
    if (this.answers.length > 9) this.answers.shift();
    this.latency = this.answers.toSorted((a, b) => a - b)[this.answers.length >> 1];
    return undefined;
  }

  closed({ code, reason }) {
    if (this.isDone) return;
    if (code === REFUSED || code === ENDED) {
      this.isDone = true;
      this.on.closed(reason || "The session has ended.");
      return;
    }
    this.lostAt ??= performance.now();
    const left = KEEP_TRYING_MS - (performance.now() - this.lostAt);
    if (left <= 0) {
      this.isDone = true;
      this.on.closed("The connection to the server is lost, and a minute of trying did not bring it back. Nothing that was driven is lost: reload the page to go on.");
      return;
    }
    this.on.lost(Math.ceil(left / 1000));
    setTimeout(() => this.open(), TRY_EVERY_MS);
  }

  ping() {
    const latency = this.latency === undefined ? {} : { latency_ms: Math.round(this.latency * 10) / 10 };
    this.ask({ do: "ping", time: performance.now(), ...latency });
  }

  ask(request) {
    if (this.isOpen) this.socket.send(JSON.stringify(request));
  }

  send(bytes) {
    if (this.isOpen) this.socket.send(bytes);
  }

  leave() {
    this.isDone = true;
    this.socket.close(ENDED);
  }
}
