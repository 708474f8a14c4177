// Draws a sample: the camera's picture with zone and boxes, and the LiDAR from above. Colours and scales are those of
// `harmzone view`.

const COLOR = {
  panel: "#0b0e13", wedge: "#141a23", ring: "#2c3747", soft: "#97a5b8", zone: "#3ddc84", ego: "#dde4ee", ink: "#0c0f14",
  harmful: "#ff4d57", harmless: "#54a8ff", unknown: "#b8c2d0", foundHarmful: "#ffb938", foundHarmless: "#cbb2ff",
  fault: "#eef2f7",
};
const HEIGHTS = [[0x48, 0x5c, 0x7a], [0x55, 0x92, 0xb5], [0x87, 0xc7, 0xb5], [0xf3, 0xe6, 0xa8]];
const HIGH_M = 3;
const N_HEIGHTS = 24;
const AHEAD_M = 60;
const BEHIND_M = 3;
const RING_M = 10;
const EGO = { width: 1.9, rear: 0.9 };
/** Nothing nearer than this is projected: lines are cut there, metres. */
const NEAR_M = 0.25;
const EDGES = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]];

const heightColors = Array.from({ length: N_HEIGHTS }, (_, step) => {
  const at = (step / (N_HEIGHTS - 1)) * (HEIGHTS.length - 1);
  const i = Math.min(Math.floor(at), HEIGHTS.length - 2);
  const mixed = HEIGHTS[i].map((low, part) => Math.round(low + (HEIGHTS[i + 1][part] - low) * (at - i)));
  return `rgb(${mixed.join(" ")})`;
});

/** Base rectangle of a box, counter-clockwise from the front left corner. */
function footprint({ center, size, yaw }) {
  const [sin, cos] = [Math.sin(yaw), Math.cos(yaw)];
  return [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([along, across]) => {
    const [x, y] = [(along * size[0]) / 2, (across * size[1]) / 2];
    return [center[0] + x * cos - y * sin, center[1] + x * sin + y * cos];
  });
}

/** What is to be drawn, the farthest first and faults over all; a narrow picture has no room for each score. */
function marks(frame, layers, isNarrow = false) {
  const truth = layers.truth ? (frame.objects ?? []) : [];
  const found = layers.found ? (frame.detections ?? []) : [];
  const all = [
    ...truth.map((of) => ({
      of, color: COLOR[of.harm ?? "unknown"], width: 1.5, dash: of.is_unfamiliar, isFault: Boolean(of.fault),
      tag: of.fault ? "missed" : of.is_unfamiliar || of.harm === "harmful" ? of.category?.replaceAll("_", " ") : null,
    })),
    ...found.map((of) => ({
      of, color: of.harm === "harmful" ? COLOR.foundHarmful : COLOR.foundHarmless, width: 2.6, dash: false,
      isFault: Boolean(of.fault), tag: of.fault ? `${of.score.toFixed(2)} false` : isNarrow && of.harm !== "harmful" ? null : of.score.toFixed(2),
    })),
  ];
  return all.sort((a, b) => a.isFault - b.isFault || b.of.center[0] - a.of.center[0]);
}

/** A canvas of the size at which it is shown, cleared; units are its CSS pixels. */
function prepare(canvas) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [wide, high] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.setLineDash([]);
  pen.fillStyle = COLOR.panel;
  pen.fillRect(0, 0, width, height);
  return [pen, width, height];
}

function trace(pen, corners) {
  pen.beginPath();
  corners.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
}

function fill(pen, corners, color, alpha) {
  if (corners.length < 3) return;
  trace(pen, corners);
  pen.closePath();
  pen.globalAlpha = alpha;
  pen.fillStyle = color;
  pen.fill();
  pen.globalAlpha = 1;
}

function outline(pen, corners, color, width, dash) {
  if (corners.length < 2) return;
  trace(pen, corners);
  pen.closePath();
  Object.assign(pen, { strokeStyle: color, lineWidth: width });
  pen.setLineDash(dash ? [5, 4] : []);
  pen.stroke();
  pen.setLineDash([]);
}

/** The camera as a function from the ego frame to the canvas. */
class Lens {
  constructor({ camera_from_ego: m, fx_px, fy_px, cx_px, cy_px }, scale, left, top) {
    this.turn = ([x, y, z]) => [0, 4, 8].map((row) => m[row] * x + m[row + 1] * y + m[row + 2] * z + m[row + 3]);
    this.pixel = ([x, y, z]) => [left + scale * (cx_px + (fx_px * x) / z), top + scale * (cy_px + (fy_px * y) / z)];
  }

  /** A segment, cut at the near plane; `null` behind it. */
  segment(a, b) {
    const [near, far] = a[2] < b[2] ? [a, b] : [b, a];
    if (far[2] <= NEAR_M) return null;
    return [this.pixel(near[2] < NEAR_M ? cut(near, far) : near), this.pixel(far)];
  }

  /** A polygon on the ground, cut at the near plane. */
  ground(corners) {
    const turned = corners.map(([x, y]) => this.turn([x, y, 0]));
    const kept = [];
    turned.forEach((current, i) => {
      const next = turned[(i + 1) % turned.length];
      if (current[2] >= NEAR_M) kept.push(current);
      if (current[2] >= NEAR_M !== next[2] >= NEAR_M) kept.push(cut(current, next));
    });
    return kept.map((corner) => this.pixel(corner));
  }

  corners(of) {
    const base = footprint(of);
    const [low, high] = [of.center[2] - of.size[2] / 2, of.center[2] + of.size[2] / 2];
    return [...base.map(([x, y]) => [x, y, low]), ...base.map(([x, y]) => [x, y, high])].map((corner) => this.turn(corner));
  }
}

function cut(a, b) {
  const t = (NEAR_M - a[2]) / (b[2] - a[2]);
  return a.map((value, i) => value + (b[i] - value) * t);
}

/** The camera's picture with what is asked for over it. */
export function drawCamera(canvas, frame, layers) {
  const { width_px, height_px } = frame.camera;
  canvas.style.aspectRatio = `${width_px} / ${height_px}`;
  const [pen, width, height] = prepare(canvas);
  const scale = Math.min(width / width_px, height / height_px);
  const [left, top] = [(width - scale * width_px) / 2, (height - scale * height_px) / 2];
  pen.save();
  pen.beginPath();
  pen.rect(left, top, scale * width_px, scale * height_px);
  pen.clip();
  pen.imageSmoothingQuality = "high";
  if (frame.picture) pen.drawImage(frame.picture, left, top, scale * width_px, scale * height_px);
  const lens = new Lens(frame.camera, scale, left, top);
  if (layers.zone && frame.zone) {
    const ground = lens.ground(frame.zone);
    fill(pen, ground, COLOR.zone, 0.24);
    outline(pen, ground, COLOR.zone, 1.6);
  }
  const all = marks(frame, layers, width < 480);
  for (const mark of all) drawBox(pen, lens, mark);
  const taken = [];
  for (const mark of all.reverse()) drawTag(pen, lens, mark, width, taken);
  pen.restore();
}

function drawBox(pen, lens, { of, color, width, dash, isFault }) {
  const corners = lens.corners(of);
  const lines = EDGES.map(([from, to]) => lens.segment(corners[from], corners[to])).filter(Boolean);
  // A line below each keeps the colour readable on a bright wall, and marks faults.
  const below = isFault ? [COLOR.fault, width + 3.4, 0.95] : [COLOR.panel, width + 1.6, 0.35];
  for (const [tone, wide, alpha] of [below, [color, width, 1]]) {
    Object.assign(pen, { strokeStyle: tone, lineWidth: wide, globalAlpha: alpha, lineCap: "round" });
    pen.setLineDash(dash ? [5, 4] : []);
    pen.beginPath();
    for (const [from, to] of lines) {
      pen.moveTo(...from);
      pen.lineTo(...to);
    }
    pen.stroke();
  }
  pen.globalAlpha = 1;
  pen.setLineDash([]);
}

function drawTag(pen, lens, { of, color, tag, isFault }, width, taken) {
  if (!tag) return;
  const seen = lens.corners(of).filter((corner) => corner[2] > NEAR_M).map((corner) => lens.pixel(corner));
  if (!seen.length) return;
  const xs = seen.map(([x]) => x);
  const [from, to, high] = [Math.min(...xs), Math.max(...xs), Math.min(...seen.map(([, y]) => y))];
  if (to < 0 || from > width) return;
  pen.font = "600 12px system-ui, sans-serif";
  const wide = pen.measureText(tag).width + 8;
  const x = Math.min(Math.max((from + to) / 2 - wide / 2, 2), Math.max(width - wide - 2, 2));
  let y = Math.max(high - 20, 2);
  for (let row = 0; row < 3 && y >= 2; row++, y -= 18) {
    const box = [x, y, x + wide, y + 16];
    if (taken.some((other) => box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3])) continue;
    taken.push(box);
    pen.fillStyle = isFault ? COLOR.fault : color;
    pen.beginPath();
    pen.roundRect(x, y, wide, 16, 4);
    pen.fill();
    pen.fillStyle = COLOR.ink;
    pen.fillText(tag, x + 4, y + 12);
    return;
  }
}

/** The LiDAR from above: the ego at the bottom, ahead is up. */
export function drawAbove(canvas, frame, layers) {
  const [pen, width, height] = prepare(canvas);
  const scale = height / (AHEAD_M + BEHIND_M);
  const at = (x, y) => [width / 2 - y * scale, height - (x + BEHIND_M) * scale];
  drawRings(pen, at, frame.camera, scale, width);
  if (layers.points && frame.points) drawPoints(pen, frame.points, at, width, height, scale);
  if (layers.zone && frame.zone) {
    const corners = frame.zone.map(([x, y]) => at(x, y));
    fill(pen, corners, COLOR.zone, 0.2);
    outline(pen, corners, COLOR.zone, 1.4);
  }
  for (const { of, color, width: wide, dash, isFault } of marks(frame, layers)) {
    const corners = footprint(of).map(([x, y]) => at(x, y));
    if (isFault) outline(pen, corners, COLOR.fault, wide + 3.4);
    fill(pen, corners, color, 0.16);
    outline(pen, corners, color, wide, dash);
    const front = [(corners[0][0] + corners[3][0]) / 2, (corners[0][1] + corners[3][1]) / 2];
    trace(pen, [at(of.center[0], of.center[1]), front]);
    Object.assign(pen, { strokeStyle: color, lineWidth: wide });
    pen.stroke();
    if (isFault) {
      pen.beginPath();
      pen.arc(...at(of.center[0], of.center[1]), (Math.hypot(of.size[0], of.size[1]) / 2 + 1) * scale, 0, 2 * Math.PI);
      Object.assign(pen, { strokeStyle: COLOR.fault, lineWidth: 2 });
      pen.stroke();
    }
  }
  const [left, top] = at(frame.front_bumper_x_m, EGO.width / 2);
  const [right, bottom] = at(-EGO.rear, -EGO.width / 2);
  pen.fillStyle = COLOR.ego;
  pen.beginPath();
  pen.roundRect(left, top, right - left, bottom - top, 3);
  pen.fill();
}

function drawRings(pen, at, camera, scale, width) {
  const half = Math.atan(camera.width_px / 2 / camera.fx_px);
  const [x, y] = at(0, 0);
  const [from, to] = [-Math.PI / 2 - half, -Math.PI / 2 + half];
  pen.fillStyle = COLOR.wedge;
  pen.beginPath();
  pen.moveTo(x, y);
  pen.arc(x, y, AHEAD_M * scale, from, to);
  pen.closePath();
  pen.fill();
  pen.font = "11px system-ui, sans-serif";
  for (let range = RING_M; range <= AHEAD_M; range += RING_M) {
    pen.beginPath();
    pen.arc(x, y, range * scale, from, to);
    Object.assign(pen, { strokeStyle: COLOR.ring, lineWidth: 1, fillStyle: COLOR.soft });
    pen.stroke();
    const [end, label] = [x + range * scale * Math.sin(half) + 4, `${range} m`];
    pen.fillText(label, Math.min(end, width - pen.measureText(label).width - 3), y - range * scale * Math.cos(half) + 4);
  }
}

function drawPoints(pen, points, at, width, height, scale) {
  const steps = Array.from({ length: N_HEIGHTS }, () => []);
  for (let i = 0; i + 2 < points.length; i += 3) {
    const share = Math.min(Math.max(points[i + 2] / 100 / HIGH_M, 0), 1);
    const [x, y] = at(points[i] / 100, points[i + 1] / 100);
    if (x >= 0 && x < width && y >= 0 && y < height) steps[Math.min(Math.floor(share * N_HEIGHTS), N_HEIGHTS - 1)].push(x, y);
  }
  const size = Math.max(1, scale / 5);
  steps.forEach((dots, step) => {
    pen.fillStyle = heightColors[step];
    for (let i = 0; i < dots.length; i += 2) pen.fillRect(dots[i] - size / 2, dots[i + 1] - size / 2, size, size);
  });
}

/** The bar over the seek slider: which samples have harm, and which faults. */
export function drawMarks(canvas, counts, nSamples) {
  const [pen, width, height] = prepare(canvas);
  pen.clearRect(0, 0, width, height);
  const style = getComputedStyle(canvas);
  const rows = [["harmful", "--harm"], ["missed", "--miss"], ["false_alarms", "--alarm"]];
  rows.forEach(([key, tone], row) => {
    pen.fillStyle = style.getPropertyValue(tone);
    (counts[key] ?? []).forEach((n, i) => {
      const step = width / nSamples;
      if (n) pen.fillRect(i * step, row * (height / 3), Math.max(step - 1, 1), height / 3 - 1);
    });
  });
}
