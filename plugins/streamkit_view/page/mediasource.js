// Decodes H.264 with a media source and a video element, where the page has no WebCodecs: browsers offer those only at
// localhost and over https. It has the methods of a VideoDecoder that the player calls, and gives image bitmaps.

const LIBRARY = "./jmuxer.min.js";
const FRAME_MS = 40; // until two frames tell their distance
const PAUSE_MS = 500; // frames further apart follow one another
const REORDER_MS = 200; // most that a frame is shown after frames that follow it in decoding order
const BEHIND_S = 0.5; // then it jumps to this long before the newest frame:
const JUMP_S = 0.3; // a jump ends only once some frames after its place are there, and after the last none come
const START_CODE = [0, 0, 0, 1];

export class MediaSourceDecoder {
  static async isConfigSupported({ codec }) {
    const isKnown = codec.startsWith("avc1.") && "requestVideoFrameCallback" in HTMLVideoElement.prototype;
    return { supported: isKnown && Boolean(window.MediaSource?.isTypeSupported(`video/mp4; codecs="${codec}"`)) };
  }

  constructor({ output, error }) {
    Object.assign(this, { output, error, state: "unconfigured", waiting: [], timeline: new Timeline(), shown: new Map() });
  }

  get decodeQueueSize() {
    return this.waiting.length;
  }

  configure({ description }) {
    this.box = description ? readBox(description) : null;
    this.state = "configured";
    this.open().catch((error) => this.error(error));
  }

  async open() {
    await import(LIBRARY);
    if (this.state === "closed") return;
    const video = this.video = Object.assign(document.createElement("video"), { muted: true, autoplay: true });
    video.requestVideoFrameCallback((now, frame) => this.present(frame));
    this.muxer = new window.JMuxer({
      node: video, mode: "video", flushingTime: 0, maxDelay: Infinity,
      onReady: () => {
        this.isOpen = true;
        this.waiting.splice(0).forEach((chunk) => this.feed(chunk));
      },
      onError: ({ error }) => this.state !== "closed" && this.error(new Error(error)),
    });
  }

  decode(chunk) {
    if (this.isOpen) this.feed(chunk);
    else this.waiting.push(chunk);
  }

  feed({ type, timestamp, data }) {
    const { at, duration, offset } = this.timeline.place(timestamp / 1000);
    this.shown.set(at + offset, timestamp);
    if (this.shown.size > 500) this.shown.delete(this.shown.keys().next().value);
    const video = this.box ? withStartCodes(data, this.box, type === "key") : data;
    this.muxer.feed({ video, duration, compositionTimeOffset: offset, isLastVideoFrameComplete: true });
    this.catchUp();
  }

  catchUp() {
    const { buffered, currentTime, seeking, paused } = this.video;
    const end = buffered.length ? buffered.end(buffered.length - 1) : 0;
    if (!seeking && end - currentTime > BEHIND_S) this.video.currentTime = end - JUMP_S;
    if (paused && end) this.video.play().catch(() => {}); // interrupted by a jump, or by close
  }

  async present({ mediaTime }) {
    if (this.state === "closed") return;
    this.video.requestVideoFrameCallback((now, frame) => this.present(frame));
    const timestamp = this.shown.get(Math.round(1000 * mediaTime));
    const image = await createImageBitmap(this.video);
    if (timestamp === undefined || this.state === "closed") return image.close();
    return this.output(Object.assign(image, { timestamp, displayWidth: image.width, displayHeight: image.height }));
  }

  // Shows all that it has: it holds frames until others follow them.
  async flush() {
    const source = this.muxer?.mediaSource;
    for (const buffer of source?.sourceBuffers ?? []) {
      if (buffer.updating) await new Promise((done) => buffer.addEventListener("updateend", done, { once: true }));
    }
    if (source?.readyState === "open") source.endOfStream();
  }

  close() {
    this.state = "closed";
    this.muxer?.destroy();
    this.video?.removeAttribute("src");
    this.video?.load();
  }
}

// Where frames lie on the time line of the video element, in whole ms and without holes, at which it would stop.
class Timeline {
  constructor() {
    Object.assign(this, { at: 0, exact: 0, first: null, last: null, step: FRAME_MS, least: PAUSE_MS, isReordered: false });
  }

  // Of the next frame in decoding order: time and duration of decoding, and how much later it is shown.
  place(pts) {
    this.first ??= pts;
    const step = pts - (this.last ?? pts - this.step);
    this.last = pts;
    this.isReordered ||= step < 0;
    if (Math.abs(step) > PAUSE_MS) this.first += step - this.step;
    else if (step) {
      this.least = Math.min(this.least, Math.abs(step));
      this.step = this.isReordered ? this.least : step;
    }
    const at = this.at;
    this.exact += this.step;
    this.at = Math.max(at + 1, Math.round(this.exact));
    const offset = this.isReordered ? Math.max(0, Math.round(pts - this.first) - at + REORDER_MS) : REORDER_MS;
    return { at, duration: this.at - at, offset };
  }
}

// Length of a unit's size and the parameter sets of an avcC box (ISO/IEC 14496-15, 5.3.3.1), with start codes.
function readBox(box) {
  const sets = [];
  let at = 5;
  for (const mask of [0x1f, 0xff]) {
    for (let left = box[at++] & mask; left > 0; left -= 1) {
      const length = (box[at] << 8) | box[at + 1];
      sets.push(...START_CODE, ...box.subarray(at + 2, at + 2 + length));
      at += 2 + length;
    }
  }
  return { sets, lengthSize: (box[4] & 3) + 1 };
}

function withStartCodes(data, { sets, lengthSize }, isKeyframe) {
  const parts = isKeyframe ? [sets] : [];
  for (let at = 0; at + lengthSize < data.length;) {
    const length = data.subarray(at, at + lengthSize).reduce((sum, byte) => 256 * sum + byte, 0);
    parts.push(START_CODE, data.subarray(at + lengthSize, at + lengthSize + length));
    at += lengthSize + length;
  }
  const units = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  parts.reduce((at, part) => (units.set(part, at), at + part.length), 0);
  return units;
}
