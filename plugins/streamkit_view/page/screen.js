// Shows pictures. Decoded video goes to a video element as a stream: the browser's compositor takes the frames as they
// are, where a canvas converts and copies each in the page's thread. Stills, video that is to be turned, and browsers
// without such streams, get a canvas, which gives the video element its place, too.

export class Screen {
  constructor(canvas, video) {
    Object.assign(this, { canvas, video, writer: null });
  }

  // The element that shows a picture; it can be drawn.
  get picture() {
    return this.video.hidden ? this.canvas : this.video;
  }

  // Closes the image. The size is that of the picture, which is the image turned upside down where `flipped`, then
  // rotated counter-clockwise by `rotation`, degrees.
  show(image, width, height, { flipped = false, rotation = 0 }) {
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const canStream = "MediaStreamTrackGenerator" in window && image instanceof window.VideoFrame;
    const isStreamed = canStream && !flipped && !rotation;
    if (isStreamed) this.stream(image);
    else {
      const context = canvas.getContext("2d");
      const [across, down] = rotation % 180 ? [height, width] : [width, height]; // of the image
      context.setTransform(1, 0, 0, 1, width / 2, height / 2);
      context.rotate(-rotation * Math.PI / 180);
      context.scale(1, flipped ? -1 : 1);
      context.drawImage(image, -across / 2, -down / 2, across, down);
      context.resetTransform();
      image.close();
    }
    this.video.hidden = !isStreamed;
  }

  // The track closes the frame. A frame that it does not take is followed by another.
  stream(frame) {
    if (!this.writer) {
      const track = new window.MediaStreamTrackGenerator({ kind: "video" });
      this.writer = track.writable.getWriter();
      this.video.srcObject = new MediaStream([track]);
    }
    this.writer.write(frame).catch(() => frame.close());
  }

  clear() {
    this.video.hidden = true;
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
  }
}
