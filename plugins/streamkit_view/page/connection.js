// The websocket to the server: takes messages, confirms them, and connects again when it is lost.

const CONFIRM_MS = 50; // one answer confirms all messages of this time
const RETRY_MS = [250, 500, 1000, 2000];

export class Connection {
  // `receive(message, payload)` may return a promise: the message is confirmed when that is done.
  constructor({ receive, opened, lost }) {
    this.receive = receive;
    this.opened = opened;
    this.lost = lost;
    this.tries = 0;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/feed`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.taken = 0;
    clearTimeout(this.confirming);
    this.confirming = null;
    let order = Promise.resolve();
    socket.onopen = () => {
      this.tries = 0;
      this.opened();
    };
    socket.onmessage = (event) => {
      order = order.then(() => this.take(socket, event.data)).catch((error) => console.error(error));
    };
    socket.onclose = (event) => {
      this.lost(event.code);
      setTimeout(() => this.open(), RETRY_MS[Math.min(this.tries++, RETRY_MS.length - 1)]);
    };
  }

  async take(socket, data) {
    if (socket !== this.socket) return;
    try {
      if (typeof data === "string") {
        await this.receive(JSON.parse(data), null);
      } else {
        const length = new DataView(data).getUint32(0, true);
        const header = new TextDecoder().decode(new Uint8Array(data, 4, length));
        await this.receive(JSON.parse(header), new Uint8Array(data, 4 + length));
      }
    } finally {
      if (socket === this.socket) this.confirm();
    }
  }

  confirm() {
    this.taken += 1;
    this.confirming ??= setTimeout(() => {
      this.confirming = null;
      this.send({ taken: this.taken });
    }, CONFIRM_MS);
  }

  // One of the answers that the server reads: `PageAnswer`.
  send(answer) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(answer));
  }
}

// The JSON value in a payload that zlib compressed.
export async function decompressed(payload) {
  const { readable, writable } = new DecompressionStream("deflate");
  const writer = writable.getWriter();
  const [found] = await Promise.all([new Response(readable).json(), writer.write(payload), writer.close()]);
  return found;
}
