// Shows pictures. Decoded video goes to a video element as a stream: the browser's compositor takes the frames as they
// are, where a canvas converts and copies each in the page's thread. Stills, and browsers without such streams, get a
// canvas, which gives the video element its place, too.

export class Screen {
  constructor(canvas, video) {
    Object.assign(this, { canvas, video, writer: null });
  }

  // The element that shows a picture; it can be drawn.
  get picture() {
    return this.video.hidden ? this.canvas : this.video;
  }

  // Closes the image.
  show(image, width, height) {
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const isStreamed = "MediaStreamTrackGenerator" in window && image instanceof window.VideoFrame;
    if (isStreamed) this.stream(image);
    else {
      canvas.getContext("2d").drawImage(image, 0, 0, width, height);
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
