// The websocket to the server: takes messages, confirms them, and connects again when it is lost.

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
      this.taken += 1;
      this.send({ taken: this.taken });
    }
  }

  // One of the answers that the server reads: `PageAnswer`.
  send(answer) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(answer));
  }
}

// The JSON value in a payload that zlib compressed.
export async function decompressed(payload) {
  const stream = new Blob([payload]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).json();
}
