// Boxes, ids, trails and position errors, drawn over the video in pixels of the screen.

import { corners } from "./geometry.js";

const COLOURS = { confirmed: "#ffd60a", coasting: "#ff9f0a", tentative: "#c7ccd4", followed: "#32d7ff" };

export function fitCanvas(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  return ratio;
}

// The frame keeps its shape in a canvas of another one: scale and margins, screen pixels.
export function placement(canvas, width, height) {
  const scale = Math.min(canvas.width / width, canvas.height / height);
  return { scale, left: (canvas.width - width * scale) / 2, top: (canvas.height - height * scale) / 2 };
}

export function drawTracks(canvas, size, record, trails, followed, isExact) {
  const ratio = fitCanvas(canvas);
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (!record) return;
  const place = placement(canvas, size.width, size.height);
  const shrink = record.width ? size.width / record.width : 1;
  const at = ([x, y]) => [place.left + x * shrink * place.scale, place.top + y * shrink * place.scale];
  context.globalAlpha = isExact ? 1 : 0.5;
  context.lineJoin = "round";
  for (const track of record.tracks) {
    if (track.state === "lost") continue;
    const isFollowed = track.id === followed;
    const colour = isFollowed ? COLOURS.followed : COLOURS[track.state] ?? COLOURS.confirmed;
    if (track.state !== "tentative") drawTrail(context, trails.inFrame(record, track.id).map(at), colour, ratio);
    outline(context, corners(track).map(at), colour, ratio * (isFollowed ? 3 : 2), track.state !== "confirmed");
    if (isFollowed && track.position_covariance) drawError(context, track, at, shrink * place.scale, colour, ratio);
    if (track.state !== "tentative") {
      drawLabel(context, String(track.id), at([track.bbox[0], track.bbox[1]]), colour, ratio);
    }
  }
  context.globalAlpha = 1;
}

// The box that is being drawn, between two points of the frame.
export function drawBox(canvas, size, [x0, y0], [x1, y1]) {
  const place = placement(canvas, size.width, size.height);
  const at = ([x, y]) => [place.left + x * place.scale, place.top + y * place.scale];
  const points = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(at);
  outline(canvas.getContext("2d"), points, COLOURS.followed, 2 * (window.devicePixelRatio || 1));
}

export function outline(context, points, colour, thickness, isDashed = false) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.closePath();
  context.setLineDash([]);
  context.strokeStyle = "rgba(0, 0, 0, 0.55)";
  context.lineWidth = thickness * 2;
  context.stroke();
  context.setLineDash(isDashed ? [thickness * 2.5, thickness * 2] : []);
  context.strokeStyle = colour;
  context.lineWidth = thickness;
  context.stroke();
  context.setLineDash([]);
}

function drawTrail(context, points, colour, ratio) {
  if (points.length < 2) return;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  const opacity = context.globalAlpha;
  context.globalAlpha = 0.65 * opacity;
  context.strokeStyle = colour;
  context.lineWidth = 1.5 * ratio;
  context.stroke();
  context.globalAlpha = opacity;
}

// The ellipse of two standard deviations of the position.
function drawError(context, track, at, scale, colour, ratio) {
  const [[xx, xy], [, yy]] = track.position_covariance;
  const [middle, apart] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  const [x, y] = at([track.x, track.y]);
  const [long, short] = [middle + apart, Math.max(middle - apart, 0)].map((value) => 2 * Math.sqrt(value) * scale);
  context.beginPath();
  context.ellipse(x, y, long, short, Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = ratio;
  context.stroke();
}

function drawLabel(context, text, [x, y], colour, ratio) {
  context.font = `600 ${12 * ratio}px system-ui, sans-serif`;
  const width = context.measureText(text).width + 6 * ratio;
  context.fillStyle = "rgba(0, 0, 0, 0.65)";
  context.fillRect(x, y - 19 * ratio, width, 16 * ratio);
  context.fillStyle = colour;
  context.fillText(text, x + 3 * ratio, y - 7 * ratio);
}
