// What the page shows: episodes as `page.py` has written them, and words for what happened.

const PAGE = JSON.parse(document.getElementById("data").textContent);
const LOOK = PAGE.look;

/** A, B, … Z, AA, … for AUVs counted from 0. */
function auvName(index) {
  let name = "";
  for (index += 1; index > 0; index = Math.floor((index - 1) / 26)) {
    name = String.fromCharCode(65 + ((index - 1) % 26)) + name;
  }
  return name;
}

const PREFIXES = { "-12": "p", "-9": "n", "-6": "µ", "-3": "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T" };

/** An energy with three digits and a unit. */
function energyText(joules) {
  if (!(joules >= 1e-12)) return "0 J";
  const exponent = Math.min(Math.max(3 * Math.floor(Math.log10(joules) / 3), -12), 12);
  return Number((joules / 10 ** exponent).toPrecision(3)) + " " + PREFIXES[exponent] + "J";
}

const decimals = (value, digits) =>
  value < 1e5 ? value.toFixed(digits) : Number(value.toPrecision(3)).toString();

/** An age in slots, of two digits where packets are younger than a slot. */
const ageText = (slots) => String(Number(slots.toFixed(2)));

/** Seconds as 45 s, 3 min 20 s, 2 h 5 min. */
function durationText(seconds) {
  const whole = Math.round(seconds);
  const h = Math.floor(whole / 3600), min = Math.floor(whole / 60) % 60, s = whole % 60;
  if (h) return min ? `${h} h ${min} min` : `${h} h`;
  if (min) return s ? `${min} min ${s} s` : `${min} min`;
  return `${whole < 10 ? Number(seconds.toPrecision(2)) : whole} s`;
}

/** Colour of an age, from 1 to A_max, as [red, green, blue] from 0 to 1. */
function ageColour(age, maximum) {
  const share = Math.min(Math.max((age - 1) / Math.max(maximum - 1, 1), 0), 1);
  const at = share * (LOOK.ages.length - 1), low = Math.min(Math.floor(at), LOOK.ages.length - 2);
  const parts = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
  const a = parts(LOOK.ages[low]), b = parts(LOOK.ages[low + 1]);
  return a.map((part, i) => part + (b[i] - part) * (at - low));
}
const css = (rgb) => `rgb(${rgb.map((part) => Math.round(part * 255)).join(",")})`;
const isBright = ([r, g, b]) => 0.299 * r + 0.587 * g + 0.114 * b > 0.5;

/** One episode. Cells are counted from 1, AUVs, nodes, slots and places from 0. */
class Episode {
  constructor(data) {
    Object.assign(this, data);
    this.numNodes = this.nodes.length;
    this.slots = this.charged.length / this.auvs;
    this.meanAges = Array.from({ length: this.slots + 1 }, (_, place) => {
      let sum = 0;
      for (let node = 0; node < this.numNodes; node++) sum += this.age(place, node);
      return sum / this.numNodes;
    });
    this.deliveries = [new Array(this.numNodes).fill(0)];
    for (let slot = 0; slot < this.slots; slot++) {
      const counts = this.deliveries[slot].slice();
      for (const packet of this.uplinks(slot)) if (packet.arrived) counts[packet.heard] += 1;
      this.deliveries.push(counts);
    }
  }

  /** Cell of an AUV after `place` slots. */
  cell(place, auv) {
    const at = 3 * (place * this.auvs + auv);
    return this.path.slice(at, at + 3);
  }
  /** Where it is drawn: under way between two cells. */
  spot(place, auv) {
    const at = 3 * (place * this.auvs + auv);
    return this.spots ? this.spots.slice(at, at + 3) : this.cell(place, auv);
  }
  /** Slots until the move of an AUV ends; 0 if it is not under way. */
  slotsLeft(place, auv) {
    return this.transit ? this.transit[place * this.auvs + auv] : 0;
  }
  /** The cell that it goes to. */
  target(place, auv) {
    const at = 3 * (place * this.auvs + auv);
    return this.heading.slice(at, at + 3);
  }
  /** Share of its battery that an AUV has left. */
  charge(place, auv) {
    return this.battery[place * this.auvs + auv];
  }
  /** Whether an AUV lies in a dock, and is recharged. */
  isDocked(place, auv) {
    const cell = this.cell(place, auv), docks = this.docks ?? [];
    return !this.slotsLeft(place, auv) && docks.some((dock) => dock.every((value, i) => value === cell[i]));
  }
  /** Whether a node slept through the slot before a place. */
  sleeps(place, node) {
    return Boolean(place && this.asleep && this.asleep[(place - 1) * this.numNodes + node]);
  }
  age(place, node) {
    return this.ages[place * this.numNodes + node];
  }
  energy(place, node) {
    return this.energies[place * this.numNodes + node];
  }
  /** Share of a full gauge. */
  gauge(place, node) {
    return Math.min(this.energy(place, node) / this.gauge_j, 1);
  }

  /** What each AUV did in a slot, and what came of it. */
  links(slot) {
    return Array.from({ length: this.auvs }, (_, auv) => {
      const at = slot * this.auvs + auv;
      return {
        auv,
        charged: this.charged[at] - 1, // −1 for nobody
        heard: this.heard[at] - 1, // −1 for nobody
        arrived: this.outcome[at] === 0,
        reason: this.outcome[at] ? this.reasons[this.outcome[at] - 1] : null,
        harvested_j: this.harvested[at],
        spent_j: this.spent[at],
        beta: this.beta ? this.beta[at] : null,
        stayed: this.stayed[at],
      };
    });
  }

  /** The nodes that an AUV polled beside the one that it chose, in the order of their packets. */
  polls(slot, auv) {
    const rounds = this.rounds ?? 0, first = (slot * this.auvs + auv) * rounds;
    const places = Array.from({ length: rounds }, (_, i) => first + i);
    return places.filter((at) => this.polled[at]).map((at) => ({
      auv,
      heard: this.polled[at] - 1,
      arrived: this.polled_outcome[at] === 0,
      reason: this.polled_outcome[at] ? this.reasons[this.polled_outcome[at] - 1] : null,
      spent_j: this.polled_spent[at],
    }));
  }

  /** Every node that was asked in a slot: of each AUV the chosen one first. */
  uplinks(slot) {
    return this.links(slot).flatMap((link) => [
      ...(link.heard < 0 ? [] : [link]), ...this.polls(slot, link.auv),
    ]);
  }

  /** How an AUV moved in a slot. */
  moveText(slot, auv) {
    const stayed = this.stayed[slot * this.auvs + auv];
    const left = this.slotsLeft(slot + 1, auv);
    if (left) return `under way to (${this.target(slot + 1, auv).join(", ")}), ${left} ${left > 1 ? "slots" : "slot"} left`;
    if (stayed === 1) return "stayed: edge of the grid";
    if (stayed === 2) return "stayed: another AUV too near";
    const from = this.cell(slot, auv), to = this.cell(slot + 1, auv);
    const words = ["x", "y", "z"].flatMap((axis, i) => {
      const step = to[i] - from[i];
      if (!step) return [];
      return [(step > 0 ? "+" : "−") + (Math.abs(step) > 1 ? Math.abs(step) : "") + axis];
    });
    if (words.length) return words.join(" ");
    if (this.isStranded(slot, auv)) return "stranded: battery empty";
    return this.slotsLeft(slot, auv) ? (this.currents ? "gave the move up" : "gave the move up: battery too low") : "hovered";
  }
  /** Whether the battery of an AUV was empty in a slot. */
  isStranded(slot, auv) {
    const outcome = this.outcome[slot * this.auvs + auv];
    return outcome > 0 && this.reasons[outcome - 1][0] === "stranded";
  }
  /** What an AUV has left of its battery after `place` slots, in words; empty where it has none. */
  batteryText(place, auv) {
    if (!this.battery) return "";
    const dock = this.isDocked(place, auv) ? ", recharged in the dock" : "";
    return `battery ${Math.round(100 * this.charge(place, auv))} %${dock}`;
  }

  /** The current that an AUV was in in a slot, in words; empty in still water. */
  currentText(slot, auv) {
    return this.currents ? `current ${this.currents[slot * this.auvs + auv]}` : "";
  }

  /** Jain's index of the deliveries so far. */
  jain(place) {
    const counts = this.deliveries[place];
    const sum = counts.reduce((a, b) => a + b, 0);
    return sum ? sum ** 2 / (this.numNodes * counts.reduce((a, b) => a + b * b, 0)) : 0;
  }
  delivered(place) {
    return this.deliveries[place].reduce((a, b) => a + b, 0);
  }
  /** Mean of the mean age so far: over the ends of slots, or over time. */
  meanSoFar(place) {
    if (!place) return this.meanAges[0];
    const each = Array.from({ length: place }, (_, slot) => (this.over_time ? this.meanWithin(slot) : this.meanAges[slot + 1]));
    return each.reduce((a, b) => a + b, 0) / place;
  }
  /** Mean age over a slot, in which ages grow until they reach the highest. */
  meanWithin(slot) {
    let sum = 0;
    for (let node = 0; node < this.numNodes; node++) {
      const age = this.age(slot, node), grows = Math.min(this.max_age - age, 1);
      sum += age + grows - grows * grows / 2;
    }
    return sum / this.numNodes;
  }
}

const EPISODES = PAGE.episodes.map((data) => new Episode(data));
const SLOTS = Math.max(...EPISODES.map((episode) => episode.slots));
/** Where an episode is when the clock is at a place: one that is over stays at its end. */
const within = (episode, place) => Math.min(place, episode.slots);
