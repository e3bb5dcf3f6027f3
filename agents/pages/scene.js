// Draws a scene of planarm on a canvas, as envs/rendering draws it in frames: same shapes, same palette.
// A scene is what envs/rendering/document.py makes of one: metres, ratios of limits, nothing in pixels.

const TORQUE_ARC = (120 * Math.PI) / 180; // of the arc around a joint at its torque limit
const FULL_SCALE = 1.25; // ratio at the end of an arc
const STRIPE_SPACING = 0.12;
const PART_SIZE = 0.11;
const BUCKET = [[0, -0.06], [-0.1, 0.12], [0, 0.42], [0.25, 0.6], [0.55, 0.58], [0.84, 0.36], [1, 0]];
const HOLLOW = [0.42, 0.16];

/** Linear interpolation of two "#rrggbb" colours: the first at share 0. */
export function mix(first, second, share) {
  const parts = [1, 3, 5].map((at) => {
    const [a, b] = [first, second].map((color) => parseInt(color.slice(at, at + 2), 16));
    return Math.round(a + share * (b - a)).toString(16).padStart(2, "0");
  });
  return "#" + parts.join("");
}

/** A "#rrggbb" colour with an opacity of 0 to 1. */
export function faded(color, opacity) {
  return color + Math.round(255 * opacity).toString(16).padStart(2, "0");
}

/** Colour of a bar or arc: blue within the limit, red past it; what prints as 100 % is within. */
export function ratioColor(ratio, palette) {
  return Math.round(100 * Math.abs(ratio)) <= 100 ? palette.accent : palette.bad;
}

const add = (a, b, share = 1) => [a[0] + share * b[0], a[1] + share * b[1]];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1]];
const length = (a) => Math.hypot(a[0], a[1]);

/** A canvas that shows a rectangle of the plane, undistorted and centred. */
export class SceneView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {number[]} view visible rectangle: x from, x to, y from, y to, m
   * @param {Object<string, string>} palette colours by name
   */
  constructor(canvas, view, palette) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.view = view;
    this.palette = palette;
  }

  /** Fits the bitmap to the size of the element on the screen; call before drawing. */
  fit() {
    const ratio = globalThis.devicePixelRatio || 1;
    const box = this.canvas.getBoundingClientRect();
    this.size = [box.width, box.height];
    const pixels = this.size.map((side) => Math.max(1, Math.round(side * ratio)));
    if (this.canvas.width !== pixels[0] || this.canvas.height !== pixels[1]) {
      [this.canvas.width, this.canvas.height] = pixels;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [x0, x1, y0, y1] = this.view;
    this.scale = Math.min(this.size[0] / (x1 - x0), this.size[1] / (y1 - y0));
    this.center = [(x0 + x1) / 2, (y0 + y1) / 2];
    this.unit = Math.max(0.6, Math.min(this.size[0], this.size[1]) / 640);
  }

  /** Pixels of a point in metres. */
  pixel(point) {
    return [
      this.size[0] / 2 + (point[0] - this.center[0]) * this.scale,
      this.size[1] / 2 - (point[1] - this.center[1]) * this.scale,
    ];
  }

  /** The point in metres under a pixel. */
  metres(pixel) {
    return [
      this.center[0] + (pixel[0] - this.size[0] / 2) / this.scale,
      this.center[1] - (pixel[1] - this.size[1] / 2) / this.scale,
    ];
  }

  /**
   * Draws a scene.
   * @param {object} scene
   * @param {object} options ghosts: [{scene, color}] arms drawn translucent below; plan: points ahead of the hand, m;
   *   handles: [{point, active, radius}] rings around what can be dragged; color: tint of the arm
   */
  draw(scene, { ghosts = [], plan = null, handles = [], color = null } = {}) {
    this.fit();
    this.#floor(scene.joints);
    if (scene.ground !== null) this.#ground(scene.ground);
    if (scene.belt) this.#belt(scene.belt);
    for (const disc of scene.obstacles) this.#obstacle(disc);
    if (scene.second_arm?.length) this.#secondArm(scene.second_arm);
    if (scene.target) this.#target(scene.target);
    for (const ghost of ghosts) {
      if (ghost.scene.part && scene.part && length(minus(ghost.scene.part, scene.part)) > 1e-3) {
        this.#faint(0.4, () => this.#part(ghost.scene.part, ghost.scene.settled));
      }
    }
    if (plan && plan.length > 1) this.#plan(plan, color);
    if (scene.trail) this.#trail(scene.trail, color ?? this.palette.hand);
    if (scene.part) this.#part(scene.part, scene.settled);
    for (const ghost of ghosts) this.#faint(0.38, () => this.#arm(ghost.scene, ghost.color));
    this.#arm(scene, color);
    for (const handle of handles) this.#handle(handle);
  }

  #faint(opacity, drawing) {
    this.context.globalAlpha = opacity;
    drawing();
    this.context.globalAlpha = 1;
  }

  #disc(center, radius, color) {
    this.context.fillStyle = color;
    this.context.beginPath();
    this.context.arc(center[0], center[1], Math.max(0, radius), 0, 2 * Math.PI);
    this.context.fill();
  }

  #ring(center, radius, width, color) {
    this.context.strokeStyle = color;
    this.context.lineWidth = width;
    this.context.beginPath();
    this.context.arc(center[0], center[1], radius, 0, 2 * Math.PI);
    this.context.stroke();
  }

  #line(first, last, width, color) {
    this.context.strokeStyle = color;
    this.context.lineWidth = width;
    this.context.lineCap = "butt";
    this.context.beginPath();
    this.context.moveTo(...first);
    this.context.lineTo(...last);
    this.context.stroke();
  }

  #polygon(corners, color) {
    this.context.fillStyle = color;
    this.context.beginPath();
    corners.forEach((corner, i) => (i ? this.context.lineTo(...corner) : this.context.moveTo(...corner)));
    this.context.closePath();
    this.context.fill();
  }

  /** Two discs of different radii and what lies between them. */
  #capsule(first, second, radii, color) {
    const along = minus(second, first);
    const distance = length(along);
    if (distance > 1e-9) {
      const across = [-along[1] / distance, along[0] / distance];
      this.#polygon(
        [add(first, across, radii[0]), add(second, across, radii[1]), add(second, across, -radii[1]), add(first, across, -radii[0])],
        color,
      );
    }
    this.#disc(first, radii[0], color);
    this.#disc(second, radii[1], color);
  }

  #floor(joints) {
    const { context, palette, unit } = this;
    context.fillStyle = palette.floor;
    context.fillRect(0, 0, ...this.size.map(Math.ceil)); // a pixel in part covered would keep what was there
    const reach = joints.slice(1).reduce((sum, joint, i) => sum + length(minus(joint, joints[i])), 0) * this.scale;
    const base = this.pixel(joints[0]);
    this.#disc(base, reach, palette.border);
    this.#disc(base, reach - 1.5 * unit, palette.workspace);
    const step = this.#niceStep(48 * unit);
    const low = this.metres([0, this.size[1]]);
    const high = this.metres([this.size[0], 0]);
    for (const axis of [0, 1]) {
      for (let k = Math.ceil(low[axis] / step); k <= high[axis] / step; k++) {
        const ends = [low.slice(), high.slice()];
        ends[0][axis] = ends[1][axis] = k * step;
        this.#line(this.pixel(ends[0]), this.pixel(ends[1]), (k ? 1 : 2) * unit, palette.grid);
      }
    }
    const [left, y] = [16 * unit, this.size[1] - 16 * unit];
    const right = left + step * this.scale;
    this.#line([left, y], [right, y], 2 * unit, palette.muted);
    for (const x of [left, right]) this.#line([x, y - 4 * unit], [x, y + 4 * unit], 2 * unit, palette.muted);
    context.fillStyle = palette.muted;
    context.font = `${Math.max(11, 13 * unit)}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.fillText(`${+step.toPrecision(3)} m`, (left + right) / 2, y - 7 * unit);
  }

  /** The smallest round length, m, of at least so many pixels. */
  #niceStep(pixels) {
    const decade = 10 ** Math.floor(Math.log10(pixels / this.scale));
    return decade * [1, 2, 5, 10].find((step) => step * decade * this.scale >= pixels);
  }

  #ground(height) {
    const y = this.pixel([0, height])[1];
    this.context.fillStyle = faded(this.palette.earth, 0.24);
    this.context.fillRect(0, y, this.size[0], this.size[1] - y);
    this.#line([0, y], [this.size[0], y], 2 * this.unit, this.palette.earth);
  }

  #belt(belt) {
    const { palette } = this;
    const span = minus(belt.end, belt.start);
    const whole = length(span);
    const along = [span[0] / whole, span[1] / whole];
    const across = [-along[1], along[0]];
    const place = (x, y) => this.pixel(add(add(belt.start, along, x), across, y));
    const box = (low, high, half, color) =>
      this.#polygon([place(low, -half), place(high, -half), place(high, half), place(low, half)], color);
    const half = belt.width / 2;
    const roller = 0.2 * belt.width;
    box(-roller, whole + roller, half + 0.1 * belt.width, palette.belt_rail);
    box(0, whole, half, palette.belt);
    const chevron = [[0, -1], [0.3, 0], [0, 1], [0.14, 1], [0.44, 0], [0.14, -1]];
    const first = (((belt.travel % STRIPE_SPACING) + STRIPE_SPACING) % STRIPE_SPACING) - STRIPE_SPACING;
    for (let offset = first; offset < whole; offset += STRIPE_SPACING) {
      const corners = chevron.map(([x, y]) => {
        const at = Math.min(whole, Math.max(0, 0.72 * half * x + offset));
        return place(at, 0.72 * half * y);
      });
      this.#polygon(corners, palette.belt_stripe);
    }
    for (const end of [0, whole]) {
      box(end - roller, end + roller, half, palette.roller);
      for (let k = 0; k < 4; k++) {
        const phase = (k * Math.PI) / 2 + belt.travel / roller; // light lines wander over the roller as it turns
        if (Math.cos(phase) <= 0) continue;
        const shine = end + roller * Math.sin(phase);
        const width = 0.1 * roller * Math.cos(phase);
        box(shine - width, shine + width, 0.94 * half, palette.roller_shine);
      }
    }
  }

  #part(position, settled) {
    const { palette, unit } = this;
    const center = this.pixel(position);
    const half = Math.max((PART_SIZE / 2) * this.scale, 5 * unit);
    const square = (side, height = side) =>
      [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => [center[0] + side * x, center[1] + height * y]);
    const color = settled ? palette.good : palette.waiting;
    this.#polygon(square(half).map((corner) => add(corner, [2 * unit, 3 * unit])), "#26324746");
    this.#polygon(square(half), mix(color, "#263247", 0.35));
    this.#polygon(square(half - 1.5 * unit), color);
    this.#polygon(square(0.62 * half, 0.14 * half), mix(color, "#ffffff", 0.35));
  }

  #target(position) {
    const { palette, unit } = this;
    const center = this.pixel(position);
    this.#ring(center, 11.75 * unit, 2.5 * unit, palette.good);
    this.#disc(center, 3.5 * unit, palette.good);
    for (const way of [[1, 0], [0, 1], [-1, 0], [0, -1]]) {
      this.#line(add(center, way, 9 * unit), add(center, way, 18 * unit), 2.5 * unit, palette.good);
    }
  }

  #secondArm(joints) {
    const { palette, unit } = this;
    const points = joints.map(([x, y]) => this.pixel([x, y]));
    const radius = joints[0][2] * this.scale;
    this.#disc(points[0], 1.6 * radius, palette.border);
    for (const [color, thinner] of [[palette.bad, 0], [mix(palette.bad, palette.panel, 0.62), 2.5 * unit]]) {
      for (let i = 1; i < points.length; i++) {
        this.#capsule(points[i - 1], points[i], [radius - thinner, radius - thinner], color);
      }
    }
    for (const point of points) this.#disc(point, 0.35 * radius, mix(palette.bad, palette.panel, 0.3));
  }

  #obstacle([x, y, radius]) {
    const { palette, unit } = this;
    const center = this.pixel([x, y]);
    const pixels = radius * this.scale;
    this.#disc(add(center, [2 * unit, 4 * unit]), pixels, "#26324728");
    this.#disc(center, pixels, palette.bad);
    this.#disc(center, pixels - 2.5 * unit, mix(palette.bad, palette.panel, 0.62));
    this.#disc(center, 0.35 * pixels, mix(palette.bad, palette.panel, 0.3));
  }

  #trail(trail, color) {
    const points = trail.map((point) => this.pixel(point));
    this.context.lineCap = "round";
    for (let i = 1; i < points.length; i++) {
      const youth = i / (points.length - 1);
      this.#line(points[i - 1], points[i], (2 + 2.5 * youth) * this.unit, faded(color, 0.08 + 0.82 * youth));
    }
  }

  #plan(plan, color) {
    const { context, palette, unit } = this;
    context.strokeStyle = color ?? palette.accent;
    context.lineWidth = 2 * unit;
    context.setLineDash([2 * unit, 5 * unit]);
    context.lineCap = "round";
    context.beginPath();
    plan.forEach((point, i) => {
      const place = this.pixel(point);
      i ? context.lineTo(...place) : context.moveTo(...place);
    });
    context.stroke();
    context.setLineDash([]);
  }

  #handle({ point, active, radius = 0 }) {
    const { palette, unit } = this;
    const around = Math.max(20 * unit, radius * this.scale + 6 * unit);
    this.context.setLineDash(active ? [] : [4 * unit, 4 * unit]);
    this.#ring(this.pixel(point), around, (active ? 3 : 1.5) * unit, faded(palette.accent, active ? 1 : 0.7));
    this.context.setLineDash([]);
  }

  /** The whole arm; its thickness is proportional to its reach. */
  #arm(scene, tint = null) {
    const { palette } = this;
    const points = scene.joints.map((joint) => this.pixel(joint));
    const reach = points.slice(1).reduce((sum, point, i) => sum + length(minus(point, points[i])), 0);
    const thickness = 0.04 * reach;
    const hand = points[points.length - 1];
    const before = points[points.length - 2];
    const bucket = scene.bucket !== null && scene.bucket !== undefined;
    const last = minus(hand, before);
    const wrist = add(hand, last, -Math.min((1.9 * thickness) / Math.max(length(last), 1e-9), 0.6));
    const chain = bucket ? points.slice(0, -1) : [...points.slice(0, -1), wrist];
    const links = chain.length - 1;
    const radii = chain.map((_, i) => thickness * (1 - (0.45 * i) / Math.max(1, links)));
    for (let i = 0; i < links; i++) {
      const shift = [0.18 * thickness, 0.32 * thickness];
      this.#capsule(add(chain[i], shift), add(chain[i + 1], shift), [radii[i], radii[i + 1]], "#2632471c");
    }
    this.#disc(points[0], 1.75 * thickness, mix(palette.border, palette.muted, 0.35));
    this.#disc(points[0], 1.6 * thickness, palette.border);
    for (let k = 0; k < 4; k++) {
      const direction = ((45 + 90 * k) * Math.PI) / 180;
      const bolt = add(points[0], [Math.cos(direction), Math.sin(direction)], 1.33 * thickness);
      this.#disc(bolt, 0.14 * thickness, palette.muted);
    }
    for (let i = 0; i < links; i++) {
      const own = mix(palette.link_base, palette.link_hand, i / Math.max(1, links - 1));
      const color = tint ? mix(own, tint, 0.6) : own;
      const along = minus(chain[i + 1], chain[i]);
      this.#capsule(chain[i], chain[i + 1], [radii[i], radii[i + 1]], color);
      const inlay = [0.42 * radii[i], 0.42 * radii[i + 1]];
      this.#capsule(add(chain[i], along, 0.14), add(chain[i + 1], along, -0.14), inlay, mix(color, palette.panel, 0.16));
    }
    const steel = tint ? mix(palette.link_base, tint, 0.6) : palette.link_base;
    if (bucket) this.#bucket(before, hand, thickness, scene.bucket, steel);
    else this.#gripper(wrist, hand, thickness, scene.settled, steel);
    scene.torque_ratios.forEach((ratio, joint) => this.#joint(points[joint], radii[joint], ratio));
  }

  #joint(center, radius, ratio) {
    const { context, palette } = this;
    this.#disc(center, 0.62 * radius, palette.joint);
    const sweep = TORQUE_ARC * Math.min(Math.abs(ratio), FULL_SCALE);
    if (sweep <= 0.05) return;
    for (const [width, color] of [[0.55, palette.joint], [0.3, ratioColor(ratio, palette)]]) {
      context.strokeStyle = color;
      context.lineWidth = width * radius;
      context.lineCap = "butt";
      context.beginPath(); // counter-clockwise from straight up for a positive torque; y runs down here
      context.arc(center[0], center[1], 1.45 * radius, -Math.PI / 2, -Math.PI / 2 - Math.sign(ratio) * sweep, ratio > 0);
      context.stroke();
    }
  }

  /** A palm across the wrist, two fingers around the hand, and a dot at the hand itself. */
  #gripper(wrist, hand, thickness, closed, color) {
    const span = minus(hand, wrist);
    const size = Math.max(length(span), 1e-9);
    const along = [span[0] / size, span[1] / size];
    const across = [-along[1], along[0]];
    const opening = (closed ? 0.95 : 1.25) * thickness;
    const width = 0.36 * thickness;
    this.#disc(wrist, 0.68 * thickness, color);
    this.#line(add(wrist, across, -opening), add(wrist, across, opening), 1.3 * width, color);
    for (const side of [-1, 1]) {
      const root = add(wrist, across, side * opening);
      const tip = add(add(hand, across, side * opening), along, 0.5 * thickness);
      this.#line(root, tip, width, color);
      this.#line(tip, add(tip, across, -0.2 * side * thickness), width, color);
    }
    this.#disc(hand, 0.34 * thickness, this.palette.panel);
    this.#disc(hand, 0.25 * thickness, this.palette.hand);
  }

  /** A bucket from the side with its content, and a dot at its tip. */
  #bucket(joint, tip, thickness, fill, color) {
    const { palette } = this;
    const along = minus(tip, joint);
    const left = [along[1], -along[0]]; // pixels run down
    const place = ([x, y]) => add(add(joint, along, x), left, y);
    const towards = (point, share) => [HOLLOW[0] + share * (point[0] - HOLLOW[0]), HOLLOW[1] + share * (point[1] - HOLLOW[1])];
    this.#polygon(BUCKET.map(place), color);
    this.#polygon(BUCKET.map((point) => place(towards(point, 0.82))), mix(color, palette.panel, 0.25));
    if (fill > 0) {
      const heap = [[0.1, 0], [0.45, -0.12], [0.9, 0], BUCKET[5], BUCKET[4], BUCKET[3], BUCKET[2]];
      const size = 0.8 * Math.sqrt(fill);
      const grown = heap.map(([x, y]) => place([0.45 + size * (x - 0.45), 0.4 + size * (y - 0.4)]));
      this.#polygon(grown, palette.earth);
    }
    this.#disc(tip, 0.34 * thickness, palette.panel);
    this.#disc(tip, 0.25 * thickness, palette.hand);
  }
}
