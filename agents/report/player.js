// The player of a seed: all policies on one canvas, one of them highlighted, and its traces below.
import { SceneView } from "./scene.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2];
const SVG = "http://www.w3.org/2000/svg";
const MOST = 1.5; // of a limit, at the edge of a trace

/** An element with attributes and children; texts are never read as HTML. */
export function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null));
  return made;
}

function draw(tag, attributes, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** Plays the replays of one seed; `element` is what goes into the page. */
export class Player {
  /**
   * @param {number[]} view visible rectangle, m
   * @param {{name: string, look: string, verdict: string, good: boolean, replay: Replay}[]} runs
   * @param {number} chosen which of them is highlighted
   * @param {object} palettes colours of scenes, light and dark
   */
  constructor(view, runs, chosen, palettes) {
    this.runs = runs.map((run) => ({ ...run, shown: true }));
    this.chosen = chosen;
    this.palettes = palettes;
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.time = 0;
    this.speed = 1;
    this.playing = false;
    this.canvas = make("canvas", { role: "img", "aria-label": "Replay of the episode" });
    this.canvas.style.aspectRatio = `${view[1] - view[0]} / ${view[3] - view[2]}`;
    this.view = new SceneView(this.canvas, view, this.#palette());
    this.element = make("div", { class: "player" }, this.#stage(), this.#controls(), this.#side());
    this.observer = new ResizeObserver(() => this.show());
    this.observer.observe(this.canvas);
    this.recolor = () => this.highlight(this.chosen);
    this.dark.addEventListener("change", this.recolor);
    this.highlight(chosen);
  }

  /** Ends the animation; the player cannot be used afterwards. */
  close() {
    this.playing = false;
    this.observer.disconnect();
    this.dark.removeEventListener("change", this.recolor);
  }

  get duration() {
    return Math.max(...this.runs.map((run) => run.replay.duration));
  }

  #palette() {
    return this.palettes[this.dark.matches ? "dark" : "light"];
  }

  #stage() {
    this.status = make("dl", { class: "status" });
    return make("div", { class: "stage" }, this.canvas, this.status);
  }

  #controls() {
    this.button = make("button", { type: "button", class: "play", onclick: () => this.toggle() }, "Play");
    this.slider = make("input", {
      type: "range", min: 0, max: this.duration, step: 0.01, value: 0, "aria-label": "Time",
      oninput: () => this.seek(Number(this.slider.value)),
    });
    this.clock = make("output", {}, "");
    const speeds = make("select", { "aria-label": "Speed", onchange: (event) => (this.speed = Number(event.target.value)) });
    for (const speed of SPEEDS) speeds.append(make("option", { value: speed, selected: speed === 1 }, `${speed}\u00d7`));
    return make("div", { class: "controls" }, this.button, this.slider, this.clock, speeds);
  }

  #side() {
    this.list = make("ul", { class: "runs" });
    this.runs.forEach((run, place) => {
      const shown = make("input", {
        type: "checkbox", checked: true, "aria-label": `Show ${run.name}`,
        onchange: (event) => { run.shown = event.target.checked; this.show(); },
      });
      run.chip = make("span", { class: `chip ${run.look}`, "aria-hidden": "true" });
      run.button = make(
        "button", { type: "button", onclick: () => this.highlight(place) },
        run.chip, make("b", {}, run.name), " ",
        make("span", { class: run.good ? "good" : "bad" }, run.verdict),
      );
      this.list.append(make("li", {}, shown, run.button));
    });
    this.traces = make("div", { class: "traces" });
    return make("div", { class: "side" }, this.list, this.traces);
  }

  /** Highlights a policy: it is drawn on top, and the traces are its own. */
  highlight(place) {
    this.chosen = place;
    this.view.palette = this.#palette();
    this.runs.forEach((run, i) => run.button.setAttribute("aria-pressed", String(i === place)));
    const { replay } = this.runs[place];
    const torques = replay.at(0).torque_ratios.map((_, i) => [`joint ${i + 1}`, replay.series(`torque_ratios.${i}`)]);
    const limits = replay.scene.limit_gauges.map(([label], i) => [String(label), replay.series(`limit_gauges.${i}.1`)]);
    this.cursors = [];
    this.traces.replaceChildren(
      this.#trace("Joint torque, share of its limit", torques, replay, true),
      ...(limits.length ? [this.#trace("Largest of any joint, share of its limit", limits, replay, false)] : []),
    );
    this.show();
  }

  /** Curves over time with a cursor; a click or a drag goes to that time. */
  #trace(title, curves, replay, signed) {
    const [width, height, left, right] = [400, 116, 48, 90];
    const x = (time) => left + (time / this.duration) * (width - left - right);
    const low = signed ? -MOST : 0;
    const y = (value) => 8 + ((MOST - Math.min(MOST, Math.max(low, value))) / (MOST - low)) * (height - 26);
    const svg = draw("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
    for (const value of signed ? [-1, 0, 1] : [0, 0.5, 1]) {
      const line = { x1: left, x2: width - right, y1: y(value), y2: y(value), class: Math.abs(value) === 1 ? "limit" : "grid" };
      svg.append(draw("line", line), draw("text", { x: left - 5, y: y(value) + 4, "text-anchor": "end", class: "tick" }, `${100 * value} %`));
    }
    for (const share of [0, 0.5, 1]) {
      const at = share * this.duration;
      svg.append(draw("text", { x: x(at), y: height - 3, "text-anchor": "middle", class: "tick" }, `${+at.toFixed(2)} s`));
    }
    curves.forEach(([label, values], i) => {
      const points = values.map((value, frame) => (value === null ? null : `${x(replay.times[frame]).toFixed(1)} ${y(value).toFixed(1)}`));
      const path = points.filter((point) => point !== null).join("L");
      svg.append(draw("path", { d: `M${path}`, class: `trace s${i % 6}` }));
      svg.append(draw("text", { x: width - right + 8, y: 18 + 15 * i, class: `label s${i % 6}` }, label.slice(0, 14)));
    });
    const cursor = draw("line", { y1: 4, y2: height - 16, class: "cursor" });
    svg.append(cursor);
    this.cursors.push([cursor, x]);
    const go = (event) => {
      const box = svg.getBoundingClientRect();
      const share = (((event.clientX - box.left) / box.width) * width - left) / (width - left - right);
      this.seek(Math.min(1, Math.max(0, share)) * this.duration);
    };
    svg.addEventListener("pointerdown", (event) => { svg.setPointerCapture(event.pointerId); go(event); });
    svg.addEventListener("pointermove", (event) => { if (event.buttons) go(event); });
    return make("figure", {}, make("figcaption", {}, `${title}: ${this.runs[this.chosen].name}`), svg);
  }

  toggle() {
    this.playing = !this.playing;
    this.button.textContent = this.playing ? "Pause" : "Play";
    if (!this.playing) return;
    if (this.time >= this.duration - 1e-9) this.time = 0;
    let before = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      this.time = Math.min(this.duration, this.time + (Math.max(0, now - before) / 1000) * this.speed);
      before = now;
      if (this.time >= this.duration) {
        this.playing = false;
        this.button.textContent = "Again";
      }
      this.show();
      if (this.playing) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** Goes to a time, s, and stays there if the replay is paused. */
  seek(time) {
    this.time = time;
    if (!this.playing) this.button.textContent = "Play";
    this.show();
  }

  /** Draws the moment. */
  show() {
    if (!this.canvas.isConnected) return;
    const top = this.runs[this.chosen];
    const ghosts = this.runs
      .filter((run) => run.shown && run !== top)
      .map((run) => ({ scene: run.replay.at(this.time), color: tint(run) }));
    const scene = top.replay.at(this.time);
    this.view.draw(scene, { ghosts, color: tint(top) });
    this.slider.value = this.time;
    this.slider.setAttribute("aria-valuetext", `${this.time.toFixed(2)} s`);
    this.clock.textContent = `${this.time.toFixed(2)} / ${this.duration.toFixed(2)} s`;
    for (const [cursor, x] of this.cursors) {
      cursor.setAttribute("x1", x(this.time));
      cursor.setAttribute("x2", x(this.time));
    }
    this.status.replaceChildren(
      ...scene.status.flatMap(([label, value, good]) => [
        make("dt", {}, String(label)), make("dd", { class: good ? "good" : "waiting" }, String(value)),
      ]),
    );
  }
}

/** The colour of a run as "#rrggbb". */
function tint(run) {
  const color = getComputedStyle(run.chip).color;
  const unit = color.startsWith("color(") ? 255 : 1;
  const channels = (color.match(/[\d.]+(?:e-\d+)?/g) ?? []).slice(0, 3).map((each) => Math.min(255, Math.round(unit * Number(each))));
  return `#${channels.map((each) => each.toString(16).padStart(2, "0")).join("")}`;
}
