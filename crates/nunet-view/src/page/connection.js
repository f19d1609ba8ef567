// The WebSocket: it comes back by itself, and takes one request at a time.

const FIRST_RETRY_MS = 500;
const LAST_RETRY_MS = 8000;

export class Connection {
  /** `handlers`: `open()`, `closed(message)`, `report(object)`, `frame(buffer)`. */
  constructor(handlers) {
    this.handlers = handlers;
    this.retryMs = FIRST_RETRY_MS;
    this.refusal = "";
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/ws`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.retryMs = FIRST_RETRY_MS;
      this.refusal = "";
      this.handlers.open();
    };
    this.socket.onmessage = ({ data }) => this.receive(data);
    this.socket.onclose = () => {
      this.handlers.closed(this.refusal || "not connected");
      setTimeout(() => this.connect(), this.retryMs);
      this.retryMs = Math.min(2 * this.retryMs, LAST_RETRY_MS);
    };
  }

  receive(data) {
    if (data instanceof ArrayBuffer) return this.handlers.frame(data);
    const report = JSON.parse(data);
    if (report.type === "error") this.refusal = report.message;
    return this.handlers.report(report);
  }

  /** Sends a request; without a connection it is forgotten. */
  send(request) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }
}
