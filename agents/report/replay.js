// Replays as agents/evaluation/replays.py records them: decoded once, then a scene for every moment.

/** A recorded episode of one policy. */
export class Replay {
  /**
   * @param {object} recorded an episode of the replays
   * @param {Object<string, number>} units by which the numbers of a field are multiplied, "" those of other fields
   */
  constructor(recorded, units) {
    this.returned = recorded.return;
    this.steps = recorded.length;
    this.frames = recorded.frames;
    this.scene = {};
    this.moving = [];
    for (const [path, value] of Object.entries(recorded.fixed)) place(this.scene, path, value);
    for (const [path, text] of Object.entries(recorded.numbers)) {
      const values = numbers(text, this.frames, units[path.split(".")[0]] ?? units[""]);
      const stepped = path === "settled" || path.startsWith("status.");
      this.moving.push({ ...place(this.scene, path, null), path, values, stepped });
    }
    for (const [path, text] of Object.entries(recorded.texts)) {
      this.moving.push({ ...place(this.scene, path, ""), path, values: text.split("\n"), stepped: true });
    }
    this.times = this.series("time");
    this.hand = [0, 1].map((axis) => this.series(`joints.${this.scene.joints.length - 1}.${axis}`));
  }

  /** Length of the episode, s. */
  get duration() {
    return this.times[this.frames - 1];
  }

  /** The values of a number, one a frame. */
  series(path) {
    const found = this.moving.find((each) => each.path === path);
    return found ? found.values : new Array(this.frames).fill(path.split(".").reduce((item, key) => item?.[key], this.scene));
  }

  /** The scene at a time, s, between frames interpolated; the same object every time. */
  at(time) {
    const [frame, share] = this.#between(time);
    const next = Math.min(frame + 1, this.frames - 1);
    for (const { parent, key, values, stepped } of this.moving) {
      const [first, second] = [values[frame], values[next]];
      parent[key] = stepped || first === null || second === null ? first : first + share * (second - first);
    }
    this.scene.trail = [];
    for (let i = 0; i <= frame; i++) this.scene.trail.push([this.hand[0][i], this.hand[1][i]]);
    this.scene.trail.push(this.scene.joints[this.scene.joints.length - 1].slice());
    return this.scene;
  }

  /** The last frame at or before a time, and how far the time is on the way to the next. */
  #between(time) {
    let [low, high] = [0, this.frames - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= time + 1e-9) low = middle;
      else high = middle - 1;
    }
    const gap = low + 1 < this.frames ? this.times[low + 1] - this.times[low] : 0;
    return [low, gap > 0 ? Math.min(1, Math.max(0, (time - this.times[low]) / gap)) : 0];
  }
}

/** Numbers from text: the first, then differences, in units; "-" for none. */
function numbers(text, count, unit) {
  let sum = 0;
  const values = text.split(" ").map((each) => {
    if (each === "-") return null;
    sum += Number(each);
    return sum / unit;
  });
  if (values.length !== count) throw new Error(`${values.length} values for ${count} frames`);
  return values;
}

/** Puts a value where a path such as "joints.2.0" leads; makes lists and objects on the way. */
function place(root, path, value) {
  const keys = path.split(".");
  if (keys.includes("__proto__")) throw new Error(`no field ${path}`);
  let parent = root;
  keys.slice(0, -1).forEach((key, i) => {
    if (!Object.hasOwn(parent, key) || parent[key] === null) parent[key] = /^\d+$/.test(keys[i + 1]) ? [] : {};
    parent = parent[key];
  });
  const key = keys[keys.length - 1];
  parent[key] = value;
  return { parent, key };
}
