// The dialog behind a number: its episodes, worst first, and the replay of one of them.
import { Replay } from "./replay.js";
import { Player, make } from "./player.js";
import { exports, sortable } from "./exports.js";

const MOST_ROWS = 2000;

/** A number as the tables write it. */
export function numberText(value) {
  if (value === null || value === undefined) return "\u2013";
  if (value !== 0 && Math.abs(value) < 0.0005) return "<0.001";
  return Math.abs(value) < 10 ? value.toFixed(3) : value.toFixed(1);
}

/** A difference of two values that are 0 or 1. */
function pointsText(difference) {
  return difference === 1 ? "+1" : String(difference ?? "\u2013").replace("-", "\u2212");
}

/** The name in a title such as "settled (s)", and its unit. */
function split(title) {
  const found = /^(.*) \((.*)\)$/.exec(title);
  return found ? [found[1], ` ${found[2]}`] : [title, ""];
}

/** Reads an address such as #/0/2-3/settling_time/17; null if it is another. */
export function parseAddress(hash) {
  const found = /^#\/(\d+)\/(\d+)(?:-(\d+))?\/([^/]+)(?:\/(\d+))?$/.exec(hash);
  if (!found) return null;
  const key = decoded(found[4]);
  if (key === null) return null;
  const [task, first, second] = found.slice(1, 4).map((text) => (text === undefined ? null : Number(text)));
  return { task, policies: second === null ? [first] : [first, second], key, seed: found[5] ? Number(found[5]) : null };
}

/** A part of an address as it was before it was encoded; null if it is damaged. */
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return null;
  }
}

function address({ task, policies, key }, seed) {
  return `#/${task}/${policies.join("-")}/${encodeURIComponent(key)}${seed === null ? "" : `/${seed}`}`;
}

/** Value of a policy in an episode, in the unit of the quantity; null if there is none. */
function valueOf(policy, quantity, episode) {
  const value = policy.episodes[quantity.key]?.[episode];
  if (value === null || value === undefined) return null;
  return typeof value === "boolean" ? Number(value) : value * (quantity.share ? 1 : quantity.factor);
}

/** How bad an episode is: first whether it failed, then the value in which it is judged, then the return. */
function badness(task, policy, quantity, episode) {
  const value = valueOf(policy, quantity, episode);
  const failed = policy.episodes.is_success[episode] ? 0 : 1;
  const bad = value === null ? Infinity : quantity.lower ? value : -value;
  const judged = quantity.key === task.primary || quantity.key === "is_success";
  return [judged ? failed : 0, judged && failed ? 0 : bad, -(policy.episodes.return[episode] ?? 0)];
}

function compare(one, other) {
  for (let i = 0; i < one.length; i++) if (one[i] !== other[i]) return one[i] < other[i] ? 1 : -1;
  return 0;
}

/** Places of the episodes of a task, the worst of a policy (or of a difference) first. */
export function worstFirst(task, policies, quantity) {
  const [first, second] = policies.map((place) => task.policies[place]);
  const places = task.seeds.map((_, episode) => episode);
  const bad = places.map((episode) => badness(task, first, quantity, episode));
  if (second) {
    places.forEach((episode) => {
      const other = badness(task, second, quantity, episode);
      bad[episode] = bad[episode].map((value, i) => (value === other[i] ? 0 : value - other[i]));
    });
  }
  return places.sort((a, b) => compare(bad[a], bad[b]) || task.seeds[a] - task.seeds[b]);
}

/** The dialog of the episodes. */
export class Episodes {
  constructor(dialog, data) {
    this.dialog = dialog;
    this.data = data;
    this.player = null;
    dialog.addEventListener("close", () => this.#closed());
    dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
  }

  /** Shows what an address names; closes the dialog for another one. */
  open(hash) {
    const wanted = parseAddress(hash);
    const task = wanted && this.data.tasks[wanted.task];
    if (!task || wanted.policies.some((place) => !task.policies[place])) {
      if (this.dialog.open) this.dialog.close();
      return;
    }
    const quantity = task.quantities.find((each) => each.key === wanted.key) ?? task.quantities.find((each) => each.key === task.primary);
    this.dialog.classList.toggle("playing", wanted.seed !== null);
    wanted.seed ??= this.#worstRecorded(task, wanted.policies, quantity);
    this.player?.close();
    this.player = null;
    const list = this.#list(task, wanted, quantity);
    const stage = make("div", { class: "replay" });
    const names = wanted.policies.map((place) => task.policies[place].name).join(" \u2212 ");
    const name = `${task.title} ${names} ${quantity.title}`;
    this.dialog.replaceChildren(
      make("header", {},
        make("h2", { id: "episodes-title" }, `${task.title}: ${quantity.title} of ${names}`),
        make("button", { type: "button", class: "close", "aria-label": "Close", onclick: () => this.dialog.close() }, "\u00d7")),
      make("div", { class: "columns" },
        make("div", { class: "list exported" }, make("p", { class: "caption" }, this.#about(task)), make("div", { class: "scroll" }, list), exports(name)),
        stage),
    );
    sortable(list);
    if (!this.dialog.open) this.dialog.showModal();
    this.#play(stage, task, wanted, quantity);
    (stage.querySelector(".play") ?? list.querySelector("tbody a"))?.focus({ preventScroll: true });
    const row = list.querySelector('tr[aria-current="true"]');
    if (row) list.parentElement.scrollTop = row.offsetTop - list.parentElement.clientHeight / 2;
  }

  /** The seed of the worst episode with a replay; null without replays. */
  #worstRecorded(task, policies, quantity) {
    const recorded = new Set(task.replays?.seeds ?? []);
    return worstFirst(task, policies, quantity).map((episode) => task.seeds[episode]).find((seed) => recorded.has(seed)) ?? null;
  }

  #about(task) {
    const count = `${task.seeds.length} ${task.seeds.length === 1 ? "episode" : "episodes"}, the worst first. `;
    const marks = task.replays ? "\u25b6: recorded. " : "";
    return `${count}${marks}\u2717: no success.`;
  }

  /** The table of the seeds. */
  #list(task, wanted, quantity) {
    const [first, second] = wanted.policies;
    const others = task.policies.map((_, place) => place).filter((place) => !wanted.policies.includes(place));
    const shown = [...wanted.policies, ...others];
    const bound = task.bound?.key === quantity.key ? task.bound.values : null;
    const recorded = new Set(task.replays?.seeds ?? []);
    const heads = ["seed", ...(second === undefined ? [] : ["difference"]), ...shown.map((place) => task.policies[place].name), ...(bound ? ["best known"] : [])];
    const rows = worstFirst(task, wanted.policies, quantity).slice(0, MOST_ROWS).map((episode) => {
      const seed = task.seeds[episode];
      const link = make("a", { href: address(wanted, seed) }, String(seed), recorded.has(seed) ? " \u25b6" : "");
      const cells = [make("td", { "data-v": seed, class: "name" }, link)];
      const values = shown.map((place) => valueOf(task.policies[place], quantity, episode));
      if (second !== undefined) {
        const difference = values[0] === null || values[1] === null ? null : values[0] - values[1];
        cells.push(make("td", { "data-v": difference ?? "" }, quantity.share ? pointsText(difference) : numberText(difference)));
      }
      shown.forEach((place, i) => {
        const good = task.policies[place].episodes.is_success[episode];
        const chosen = place === first || place === second;
        cells.push(make("td", { "data-v": values[i] ?? "", class: chosen ? "chosen" : null }, this.#text(quantity, values[i]), good ? "" : make("span", { class: "bad", title: "no success" }, " \u2717")));
      });
      if (bound) {
        const value = bound[episode] === null ? null : bound[episode] * quantity.factor;
        cells.push(make("td", { "data-v": value ?? "", class: "muted" }, this.#text(quantity, value)));
      }
      return make("tr", { "aria-current": seed === wanted.seed ? "true" : false }, ...cells);
    });
    const head = make("tr", {}, ...heads.map((title) => make("th", { scope: "col" }, make("button", { type: "button" }, title))));
    return make("table", { class: "numbers" }, make("thead", {}, head), make("tbody", {}, ...rows));
  }

  #text(quantity, value) {
    if (quantity.share && value !== null && Number.isInteger(value)) return { 1: "yes", 0: "no" }[value] ?? numberText(value);
    return numberText(value);
  }

  #play(stage, task, wanted, quantity) {
    const recorded = task.replays?.seeds ?? [];
    if (wanted.seed === null) {
      stage.append(make("p", { class: "hint" }, "No replays were recorded; planarm benchmark --replays N records some."));
      return;
    }
    const episode = task.seeds.indexOf(wanted.seed);
    const own = (task.replays?.episodes ?? []).filter((each) => each.seed === wanted.seed);
    if (episode < 0 || !own.length) {
      const policy = task.policies[wanted.policies[0]];
      stage.append(
        make("h3", {}, `Seed ${wanted.seed}`),
        make("p", { class: "hint" }, `This episode was not recorded. ${policy.source ? "To see it:" : "Its policy had no name that a command finds."}`),
        policy.source ? make("pre", {}, command(task, policy, wanted.seed)) : "",
        make("p", { class: "hint" }, recorded.length ? "Recorded seeds: " : "", ...recorded.flatMap((seed) => [make("a", { href: address(wanted, seed) }, String(seed)), " "])),
      );
      return;
    }
    const primary = task.quantities.find((each) => each.key === task.primary) ?? quantity;
    const runs = [];
    task.policies.forEach((policy, place) => {
      const found = own.find((each) => each.policy === policy.name);
      const replay = found && replayOf(found, task.replays.units);
      if (!replay) return;
      const good = Boolean(policy.episodes.is_success[episode]);
      const value = valueOf(policy, primary, episode);
      const same = Math.abs((found.return ?? 0) - (policy.episodes.return[episode] ?? 0)) <= 1e-5 * (1 + Math.abs(found.return ?? 0));
      const [name, unit] = split(primary.title);
      const verdict = `${good ? "\u2713" : "\u2717"} ${name} ${numberText(value)}${value === null ? "" : unit}${same ? "" : ` (this replay: return ${numberText(found.return)}, not as scored)`}`;
      runs.push({ place, name: policy.name, look: policy.look, good, verdict, replay });
    });
    if (!runs.length) {
      stage.append(make("p", { class: "hint" }, "The replays of this seed cannot be read: the file of results is damaged."));
      return;
    }
    const chosen = Math.max(0, runs.findIndex((run) => run.place === wanted.policies[0]));
    this.player = new Player(task.replays.view, runs, chosen, this.data.palette);
    stage.append(make("h3", {}, `Seed ${wanted.seed}`), this.player.element);
    this.player.show();
  }

  #closed() {
    this.player?.close();
    this.player = null;
    this.dialog.replaceChildren();
    if (parseAddress(location.hash)) history.pushState(null, "", location.pathname + location.search);
  }
}

/** A replay; null if it is damaged, as in a file that somebody has changed. */
function replayOf(recorded, units) {
  try {
    const replay = new Replay(recorded, units);
    replay.at(0).torque_ratios.forEach((each) => each);
    replay.at(replay.duration).limit_gauges.forEach(([label]) => label);
    return replay;
  } catch {
    return null;
  }
}

/** The command that shows an episode. */
function command(task, policy, seed) {
  const given = (settings) => Object.entries(settings).map(([name, value]) => quoted(`${name}=${typeof value === "string" ? value : JSON.stringify(value)}`));
  const settings = given({ ...task.settings, ...policy.actions });
  const options = given(task.options);
  const parts = ["planarm rollout", quoted(task.env), "--policy", quoted(policy.source), "--seed", seed];
  if (settings.length) parts.push("--settings", ...settings);
  if (options.length) parts.push("--options", ...options);
  if (policy.source.endsWith(".zip")) parts.push("--allow-code");
  return [...parts, "--render"].join(" ");
}

function quoted(text) {
  return /^[\w.:=/+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}
