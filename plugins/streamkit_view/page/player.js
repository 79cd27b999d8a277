// Decodes coded packets, with WebCodecs or a media source. A packet waits, still coded, until the track record of its
// frame has come, so that frame and boxes are shown together; without records nothing waits, and none waits longer than a
// viewer may be behind. A packet that frames before it in time depend on is decoded with them, and its frame waits.

import { MediaSourceDecoder } from "./mediasource.js";

const HOLD_MS = 5000;
const SILENT_MS = 1500;
const HELD_LIMIT = 240;
const DECODING_LIMIT = 12;
const READY_LIMIT = 8;
const FAILURE_LIMIT = 3; // in a row, without a decoded frame between them
const END_MS = 1000; // without a packet, after the end of the stream: nothing is on the way any more
const Decoder = window.VideoDecoder ?? MediaSourceDecoder;

export class Player {
  // `show(frame, header)` takes a VideoFrame and closes it. `cannot(reason)`: stills must do instead.
  constructor({ show, cannot }) {
    this.show = show;
    this.cannot = cannot;
    this.reset();
  }

  reset() {
    if (this.decoder && this.decoder.state !== "closed") this.decoder.close();
    this.decoder = null;
    this.ready?.forEach(({ frame }) => frame.close());
    this.ready = [];
    this.held = [];
    this.headers = new Map();
    this.newest = { epoch: -1, pts: -Infinity, at: -Infinity };
    this.last = null;
    this.configured = "";
    this.parameters = null;
    this.needsKeyframe = true;
    this.failures = 0;
    this.isRefused = false;
    this.skipped = 0;
    this.generation = (this.generation ?? 0) + 1;
  }

  recordCame(epoch, pts) {
    this.newest = { epoch, pts, at: performance.now() };
    this.advance();
  }

  async push(header, { run, number }, data) {
    if (this.isRefused) return;
    const generation = this.generation;
    const isGap = this.last !== null && (run !== this.last.run || number !== this.last.number + 1);
    this.last = { run, number, at: performance.now() };
    if (isGap) this.needsKeyframe = true;
    if (header.keyframe && !(await this.prepare(header))) return;
    if (generation !== this.generation) return;
    if (this.needsKeyframe && !header.keyframe) {
      this.skipped += 1;
      return;
    }
    this.needsKeyframe = false;
    this.held.push({ header, data, config: header.keyframe ? this.parameters : null, at: performance.now() });
    if (this.held.length > HELD_LIMIT) this.skipHeld();
    this.advance();
    while (this.decoder && this.decoder.state === "configured" && this.decoder.decodeQueueSize > DECODING_LIMIT) {
      await new Promise((done) => setTimeout(done, 5));
    }
  }

  skipHeld() {
    const keyframe = this.held.findLastIndex((packet) => packet.header.keyframe);
    const count = keyframe > 0 ? keyframe : this.held.length;
    if (keyframe <= 0) this.needsKeyframe = true;
    this.skipped += count;
    this.held.splice(0, count);
  }

  // Whether this codec can be decoded; a configuration is asked for once.
  async prepare(header) {
    const name = `${header.codec} ${header.codec_data ?? ""}`;
    if (name === this.parameters?.name) return true;
    const sets = header.codec_data ? Uint8Array.from(atob(header.codec_data), (c) => c.charCodeAt(0)) : null;
    const config = { codec: header.codec ?? "", optimizeForLatency: true };
    const isBox = sets !== null && sets[0] === 1;
    if (isBox) config.description = sets;
    let isSupported = false;
    if (header.codec) {
      isSupported = await Decoder.isConfigSupported(config).then((answer) => answer.supported, () => false);
    }
    if (!isSupported) {
      this.isRefused = true;
      const remedy = window.VideoDecoder ? "" : " WebCodecs needs localhost or https.";
      this.cannot(`This browser does not decode ${header.codec ?? "this codec"}; stills are shown.${remedy}`);
      return false;
    }
    this.parameters = { name, config, prefix: sets !== null && !isBox ? sets : null };
    return true;
  }

  advance() {
    const last = this.held.findLastIndex((packet) => this.isDue(packet));
    this.held.splice(0, last + 1).forEach((packet) => this.decode(packet));
    while (this.ready.length && (this.ready.length > READY_LIMIT || this.isDue(this.ready[0]))) {
      const { frame, header } = this.ready.shift();
      this.show(frame, header);
    }
    clearTimeout(this.timer);
    if (this.held.length || this.ready.length) this.timer = setTimeout(() => this.advance(), 100);
  }

  isDue({ header, at }) {
    const now = performance.now();
    if (now - this.newest.at > SILENT_MS || now - at > HOLD_MS || header.pts_ns === undefined) return true;
    return header.epoch < this.newest.epoch || (header.epoch === this.newest.epoch && header.pts_ns <= this.newest.pts);
  }

  decode({ header, data, config }) {
    if (config !== null && (config.name !== this.configured || !this.decoder)) this.configure(config);
    if (!this.decoder || this.decoder.state !== "configured") return;
    const timestamp = Math.round((header.pts_ns ?? header.seq * 1e6) / 1000);
    this.headers.set(timestamp, header);
    if (this.headers.size > 2 * HELD_LIMIT) this.headers.delete(this.headers.keys().next().value);
    let bytes = data;
    if (config !== null && config.prefix) {
      bytes = new Uint8Array(config.prefix.length + data.length);
      bytes.set(config.prefix);
      bytes.set(data, config.prefix.length);
    }
    const chunk = { type: header.keyframe ? "key" : "delta", timestamp, data: bytes };
    try {
      this.decoder.decode(window.VideoDecoder ? new EncodedVideoChunk(chunk) : chunk);
    } catch (error) {
      this.failed(error);
    }
  }

  // The stream has ended: shows what the decoder holds, once no packet is on the way, as of the past that is played
  // again. The next stream gets a decoder of its own.
  end() {
    if (!this.configured || this.held.length || performance.now() - this.last.at < END_MS) return;
    this.configured = "";
    this.needsKeyframe = true;
    this.decoder.flush().catch(() => {}); // closed meanwhile
  }

  configure(parameters) {
    if (this.decoder && this.decoder.state !== "closed") this.decoder.close();
    const decoder = new Decoder({
      output: (frame) => {
        const header = this.headers.get(frame.timestamp);
        this.headers.delete(frame.timestamp);
        if (!header || decoder !== this.decoder) return frame.close();
        this.failures = 0;
        this.ready.push({ frame, header, at: performance.now() });
        return this.advance();
      },
      error: (error) => decoder === this.decoder && this.failed(error),
    });
    this.decoder = decoder;
    this.configured = parameters.name;
    decoder.configure(parameters.config);
  }

  // A damaged packet ends a decoder; the next keyframe begins with a new one.
  failed(error) {
    console.warn(`decoding failed: ${error.message}`);
    if (this.decoder && this.decoder.state !== "closed") this.decoder.close();
    this.decoder = null;
    this.configured = "";
    this.held = [];
    this.needsKeyframe = true;
    this.failures += 1;
    if (this.failures >= FAILURE_LIMIT) {
      this.isRefused = true;
      this.cannot("The video cannot be decoded; stills are shown.");
    }
  }
}
