// The page: its episodes side by side, one clock for all of them, and what is chosen.

const root = document.documentElement;
const find = (selector, within = document) => within.querySelector(selector);

/** An element with attributes and children; texts are texts, whatever is in them. */
function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

// ---- Theme

const THEME_KEY = "iout-replay-theme";
const preference = matchMedia("(prefers-color-scheme: dark)");
let chosenTheme = null;
try {
  chosenTheme = localStorage.getItem(THEME_KEY);
} catch {
  // Some browsers keep nothing for files.
}

function setTheme(theme) {
  root.dataset.theme = theme;
  find(".theme").textContent = theme === "dark" ? "Light theme" : "Dark theme";
  for (const panel of panels) panel.space?.retheme(chosen);
}
find(".theme").addEventListener("click", () => {
  chosenTheme = root.dataset.theme === "dark" ? "light" : "dark";
  try {
    localStorage.setItem(THEME_KEY, chosenTheme);
  } catch {
    // Then it holds until the page is left.
  }
  setTheme(chosenTheme);
});
preference.addEventListener("change", () => {
  if (!chosenTheme) setTheme(preference.matches ? "dark" : "light");
});

// ---- One episode

/** A short name of each episode, where there are two: A and B would be AUVs. */
const LINE_LOOKS = [
  { colour: "var(--first)", dash: "" },
  { colour: "var(--second)", dash: "7 4" },
];

class Panel {
  constructor(episode, index) {
    this.episode = episode;
    this.look = LINE_LOOKS[index];
    const section = make("section", { class: "episode", "aria-label": episode.policy });
    section.innerHTML = `
      <h2><svg class="key" viewBox="0 0 28 8" aria-hidden="true"><path d="M0 4H28"/></svg><span></span></h2>
      <dl class="figures"></dl>
      <p class="facts"></p>
      <div class="views">
        <figure class="space"><div class="stage"></div><div class="turners" role="group" aria-label="View"></div></figure>
        <figure class="flat"><figcaption>From above</figcaption></figure>
        <figure class="flat side"><figcaption>From the side: depth</figcaption></figure>
      </div>
      <div class="scroll" tabindex="0" role="region" aria-label="What the AUVs did in the slot">
        <table class="now"><thead><tr>
        <th scope="col">AUV</th><th scope="col">moved</th><th scope="col">charged</th>
        <th scope="col">heard</th><th scope="col">uplink</th></tr></thead><tbody></tbody></table>
      </div>
      <p class="tally"></p>`;
    find("h2 span", section).textContent = episode.policy;
    const facts = find(".facts", section);
    facts.textContent = episode.facts;
    facts.toggleAttribute("hidden", !episode.facts);
    const key = find(".key path", section);
    key.style.stroke = this.look.colour;
    key.setAttribute("stroke-dasharray", this.look.dash);
    find(".key", section).toggleAttribute("hidden", EPISODES.length === 1);
    find(".episodes").append(section);
    this.section = section;
    this.figures = find(".figures", section);
    this.body = find("tbody", section);
    const [above, side] = section.querySelectorAll(".flat");
    const grid = episode.grid.join(" × ");
    const who = `${episode.policy}: the grid of ${grid} cells`;
    this.flats = [
      new Flat(above, episode, [0, 1], true, "above", `${who} from above`, choose),
      new Flat(side, episode, [0, 2], false, "side", `${who} from the side`, choose),
    ];
    this.addSpace(find(".space", section), who);
    this.tally();
  }

  addSpace(host, who) {
    // Asked first: three.js would complain aloud.
    if (!make("canvas").getContext("webgl2")) {
      host.replaceWith(make("p", { class: "no-space" }, "This browser shows no WebGL: the maps stand for the view in space."));
      this.section.classList.add("without-space");
      return;
    }
    this.space = new Space(find(".stage", host), this.episode, choose);
    this.space.canvas.setAttribute(
      "aria-label",
      `${who} in space. Drag to turn; Shift and arrow keys turn, plus and minus zoom.`
    );
    const turners = find(".turners", host);
    const add = (text, label, act) => {
      const button = make("button", { type: "button", "aria-label": label, title: label }, text);
      button.addEventListener("click", act);
      turners.append(button);
    };
    add("⟲", "Turn left", () => this.space.turn(-20, 0));
    add("⟳", "Turn right", () => this.space.turn(20, 0));
    add("+", "Nearer", () => this.space.turn(0, 0, 0.85));
    add("−", "Farther", () => this.space.turn(0, 0, 1 / 0.85));
    add("⌂", "Whole grid", () => this.space.look());
  }

  /** How many uplinks came to what, over the whole episode. */
  tally() {
    const counts = new Map();
    let idle = 0;
    for (let slot = 0; slot < this.episode.slots; slot++) {
      for (const link of this.episode.links(slot)) if (link.heard < 0) idle += 1;
      for (const link of this.episode.uplinks(slot)) {
        const key = link.reason ? link.reason[1] : "";
        counts.set(key, (counts.get(key) ?? 0) + 1);
      }
    }
    const all = [...counts.values()].reduce((a, b) => a + b, 0);
    const words = [...counts].filter(([key]) => key).sort((a, b) => b[1] - a[1]);
    const texts = words.map(([key, count]) => `${count} × ${key}`);
    const tally = find(".tally", this.section);
    tally.append(
      make("b", {}, `${counts.get("") ?? 0} of ${all} uplinks arrived. `),
      texts.length ? `Not arrived: ${texts.join("; ")}.` : "",
      idle ? ` Nobody asked: ${idle} ×.` : ""
    );
  }

  /** Show the episode at a time; texts only where `place` has changed. */
  show(time, place, chosen, isNew) {
    const own = within(this.episode, time);
    this.space?.show(own, chosen);
    for (const flat of this.flats) flat.show(own, chosen);
    if (isNew) this.write(within(this.episode, place));
  }

  write(place) {
    const episode = this.episode;
    const facts = [
      ["mean AoI now", decimals(episode.meanAges[place], 2)],
      ["so far", decimals(episode.meanSoFar(place), 2)],
      ["packets", String(episode.delivered(place))],
      ["Jain’s index", episode.jain(place).toFixed(2)],
    ];
    this.figures.replaceChildren(
      ...facts.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value)))
    );
    if (!place) {
      this.body.replaceChildren(make("tr", {}, make("td", { colspan: 5 }, "The start: nothing has happened yet.")));
      return;
    }
    const slot = place - 1;
    this.body.replaceChildren(...episode.links(slot).map((link) => this.row(link, slot)));
  }

  row(link, slot) {
    const { episode } = this;
    const share = link.beta === null ? "" : `, β ${link.beta.toFixed(2)}`;
    const charged = link.charged < 0
      ? "nobody" : `node ${link.charged + 1}: +${energyText(link.harvested_j)}${share}`;
    const spent = link.spent_j > 0 ? `, ${energyText(link.spent_j)} spent` : "";
    const asked = link.heard >= 0;
    const outcome = make("td", asked ? { class: link.arrived ? "arrived" : "lost" } : {});
    if (asked) outcome.append(make("span", { "aria-hidden": "true" }, link.arrived ? "✓ " : "✗ "));
    const before = episode.age(slot, link.heard), after = episode.age(slot + 1, link.heard);
    outcome.append(
      link.arrived ? `packet arrived, age ${ageText(before)} → ${ageText(after)}${spent}` : `${link.reason[1]}${spent}`
    );
    const polled = episode.polls(slot, link.auv).map((packet) => {
      const cost = packet.spent_j > 0 ? `, ${energyText(packet.spent_j)} spent` : "";
      return `node ${packet.heard + 1} ${packet.arrived ? "✓" : `✗ ${packet.reason[1]}`}${cost}`;
    });
    if (polled.length) outcome.append(make("div", { class: "polled" }, `Polled: ${polled.join("; ")}`));
    const badge = make("span", { class: "auv" }, auvName(link.auv));
    badge.style.background = episode.isStranded(slot, link.auv) ? LOOK.failed : auvColour(episode, link.auv);
    const moved = [
      episode.moveText(slot, link.auv), episode.currentText(slot, link.auv), episode.batteryText(slot + 1, link.auv),
    ];
    return make(
      "tr", {}, make("th", { scope: "row" }, badge), make("td", {}, moved.filter(Boolean).join(", ")),
      make("td", {}, charged), make("td", {}, asked ? `node ${link.heard + 1}` : "nobody"), outcome
    );
  }
}

// ---- The chosen node

let chosen = -1;

function choose(node) {
  chosen = node === chosen ? -1 : node;
  pick.value = String(chosen);
  for (const charts of nodeCharts) {
    const { episode } = charts;
    const values = (of) =>
      chosen < 0 ? null : Array.from({ length: episode.slots + 1 }, (_, place) => of(place));
    charts.ages.emphasise(values((place) => episode.age(place, chosen)), "var(--data)");
    charts.energies.emphasise(values((place) => episode.energy(place, chosen)), "var(--energy)");
  }
  histories.replaceChildren(...(chosen < 0 ? [make("p", {}, "Click a node, or name one here.")] : EPISODES.map(history)));
  render(true);
}

/** What happened to the chosen node, slot by slot. */
function history(episode) {
  const part = make("div", { class: "history" });
  if (EPISODES.length > 1) part.append(make("h3", {}, episode.policy));
  const rows = [];
  let harvested = 0, spent = 0, packets = 0, worst = episode.age(0, chosen), sum = 0;
  for (let slot = 0; slot < episode.slots; slot++) {
    worst = Math.max(worst, episode.age(slot + 1, chosen));
    sum += episode.age(slot + 1, chosen);
    for (const link of episode.links(slot)) {
      const name = auvName(link.auv);
      if (link.charged === chosen) {
        harvested += link.harvested_j;
        rows.push([slot, "charged", `charged by ${name}: +${energyText(link.harvested_j)}`]);
      }
    }
    for (const link of episode.uplinks(slot)) {
      const name = auvName(link.auv);
      if (link.heard !== chosen) continue;
      spent += link.spent_j;
      packets += link.arrived ? 1 : 0;
      const cost = link.spent_j > 0 ? `, ${energyText(link.spent_j)} spent` : "";
      const age = ageText(episode.age(slot, chosen));
      rows.push(
        link.arrived
          ? [slot, "arrived", `✓ packet to ${name} at age ${age}${cost}`]
          : [slot, "lost", `✗ no packet to ${name}: ${link.reason[1]}${cost}`]
      );
    }
  }
  const left = energyText(episode.energy(episode.slots, chosen));
  const cell = episode.nodes[chosen].join(", ");
  part.append(
    make(
      "p", {},
      `Cell (${cell}). ${packets} packets; age ${decimals(sum / episode.slots, 2)} on average, ${ageText(worst)} at most; ` +
      `${energyText(harvested)} harvested, ${energyText(spent)} spent, ${left} left at the end.`
    )
  );
  const list = make("ol", { tabindex: 0, "aria-label": `What happened to node ${chosen + 1}` });
  for (const [slot, kind, text] of rows) {
    const button = make("button", { type: "button" }, `slot ${slot + 1}`);
    button.addEventListener("click", () => seek(slot + 1));
    const item = make("li", { class: kind, "data-slot": slot }, button, make("span", {}, text));
    list.append(item);
  }
  if (!rows.length) list.append(make("li", {}, "Nobody charged or heard it."));
  part.append(list);
  if (episode.asleep) {
    const slept = episode.asleep.filter((sleeps, i) => sleeps && i % episode.numNodes === chosen).length;
    find("p", part).append(` Asleep in ${slept} of ${episode.slots} slots.`);
  }
  return part;
}

/** Mark what has happened by now, and what happens now. */
function markHistory(place) {
  for (const item of histories.querySelectorAll("li[data-slot]")) {
    const slot = Number(item.dataset.slot);
    item.classList.toggle("now", slot === place - 1);
    item.classList.toggle("later", slot >= place);
  }
}

// ---- The clock

const scrub = find(".scrub"), clock = find(".clock"), status = find("[role=status]");
const speed = find(".speed select"), playButton = find(".play");
let time = 0, shownPlace = -1, isPlaying = false, before = 0;
const calm = matchMedia("(prefers-reduced-motion: reduce)");

/** Show the clock's time. */
function render(isNew = false) {
  const place = Math.ceil(time - 1e-9);
  const changed = isNew || place !== shownPlace;
  shownPlace = place;
  for (const panel of panels) panel.show(time, place, chosen, changed);
  if (changed) writeClock(place);
  showCurves(place);
}

function writeClock(place) {
  scrub.value = String(place);
  const seconds = durationText(place * EPISODES[0].slot_s);
  clock.replaceChildren(make("b", {}, `${place} / ${SLOTS}`), make("span", { class: "lasted" }, ` ${seconds}`));
  const ages = EPISODES.map(
    (episode) => `${EPISODES.length > 1 ? episode.policy + ": " : ""}mean AoI ${decimals(episode.meanAges[within(episode, place)], 1)}`
  );
  scrub.setAttribute("aria-valuetext", `slot ${place} of ${SLOTS}, ${ages.join(", ")}`);
  markHistory(place);
}

function seek(place) {
  time = Math.min(Math.max(place, 0), SLOTS);
  render();
}

function step(by) {
  play(false);
  seek(by > 0 ? Math.floor(time + 1e-9) + by : Math.ceil(time - 1e-9) + by);
  const told = panels.map((panel) => panel.body.textContent.replace(/\s+/g, " ")).join(" ");
  status.textContent = `slot ${shownPlace}. ${told}`;
}

function play(wanted) {
  if (wanted === isPlaying) return;
  isPlaying = wanted;
  playButton.setAttribute("aria-label", wanted ? "Pause" : "Play");
  find(".icon", playButton).setAttribute("d", wanted ? "M7 4h4v16H7zM14 4h4v16h-4z" : "M7 4l13 8-13 8z");
  if (!wanted) {
    seek(Math.ceil(time - 1e-9));
    return;
  }
  if (time >= SLOTS) time = 0;
  before = performance.now();
  requestAnimationFrame(advance);
}

function advance(now) {
  if (!isPlaying) return;
  // A page that was hidden, or slow, does not jump.
  const elapsed = Math.min((now - before) / 1000, 0.5);
  before = now;
  time = Math.min(time + elapsed * Number(speed.value), SLOTS);
  if (calm.matches) {
    if (Math.floor(time) !== shownPlace) {
      const exact = time;
      seek(Math.floor(time));
      time = exact;
    }
  } else render();
  if (time >= SLOTS) play(false);
  else requestAnimationFrame(advance);
}

playButton.addEventListener("click", () => play(!isPlaying));
find(".first").addEventListener("click", () => { play(false); seek(0); });
find(".back").addEventListener("click", () => step(-1));
find(".forward").addEventListener("click", () => step(1));
scrub.max = String(SLOTS);
scrub.addEventListener("input", () => { play(false); seek(Number(scrub.value)); });

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const on = event.target, space = panels.find((panel) => panel.space?.canvas === on)?.space;
  const turns = { ArrowLeft: [-10, 0], ArrowRight: [10, 0], ArrowUp: [0, -8], ArrowDown: [0, 8] };
  if (space && event.shiftKey && turns[event.key]) space.turn(...turns[event.key]);
  else if (space && "+=".includes(event.key)) space.turn(0, 0, 0.85);
  else if (space && event.key === "-") space.turn(0, 0, 1 / 0.85);
  else if (on.matches("select, ol") && event.key !== " ") return;
  else if (event.key === " " && !on.matches("button, select, a")) play(!isPlaying);
  else if (event.key === "ArrowLeft") step(-1);
  else if (event.key === "ArrowRight") step(1);
  else if (event.key === "Home") { play(false); seek(0); }
  else if (event.key === "End") { play(false); seek(SLOTS); }
  else if (event.key === "Escape" && chosen >= 0) choose(chosen);
  else return;
  event.preventDefault();
});

// ---- What happened when, above the scrub bar: arrived upwards, lost downwards

function drawTicks() {
  const canvas = find(".ticks"), pen = canvas.getContext("2d"), scale = devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  canvas.width = width * scale;
  canvas.height = height * scale;
  pen.scale(scale, scale);
  const style = getComputedStyle(root), row = height / EPISODES.length;
  EPISODES.forEach((episode, index) => {
    const middle = row * (index + 0.5);
    for (let slot = 0; slot < episode.slots; slot++) {
      const links = episode.links(slot), shareOf = (chosen) => links.filter(chosen).length / links.length;
      const share = shareOf((link) => link.arrived), lost = shareOf((link) => link.heard >= 0) - share;
      const left = 8 + (slot / SLOTS) * (width - 16), wide = Math.max((width - 16) / SLOTS - 1, 1);
      pen.fillStyle = style.getPropertyValue("--data");
      pen.fillRect(left, middle - share * (row / 2 - 1), wide, share * (row / 2 - 1));
      pen.fillStyle = style.getPropertyValue("--failed");
      pen.fillRect(left, middle, wide, lost * (row / 2 - 1));
    }
  });
}

// ---- Putting it together

const pick = find(".pick"), histories = find(".histories"), panels = [], nodeCharts = [];
root.dataset.theme = chosenTheme ?? (preference.matches ? "dark" : "light");
document.body.classList.toggle("two", EPISODES.length > 1);
find("h1").textContent = PAGE.scenario;
find(".facts").textContent = PAGE.facts;

for (const [kind, text] of PAGE.legend) {
  find(".legend").append(make("li", { class: kind }, make("i", { "aria-hidden": "true" }), text));
}
find(".legend .age i").style.background = `linear-gradient(to right, ${LOOK.ages.join(",")})`;
const most = Math.max(...EPISODES.map((episode) => episode.numNodes));
pick.append(make("option", { value: -1 }, "none"));
for (let node = 0; node < most; node++) pick.append(make("option", { value: node }, String(node + 1)));
pick.addEventListener("change", () => {
  const node = Number(pick.value);
  chosen = -1;
  choose(node);
});

EPISODES.forEach((episode, index) => panels.push(new Panel(episode, index)));
const charts = find(".charts");
const highest = (values) => values.reduce((a, b) => Math.max(a, b), 0);
const meanChart = new Chart(charts, {
  title: "Mean Age of Information, slots",
  lines: EPISODES.map((episode, index) => ({ values: episode.meanAges, ...LINE_LOOKS[index] })),
  top: roundAbove(highest(EPISODES.flatMap((episode) => episode.meanAges))),
  text: (value) => decimals(value, value < 10 && value % 1 ? 1 : 0),
  width: EPISODES.length > 1 && innerWidth > 700 ? 1080 : 520,
  seek: (place) => { play(false); seek(place); },
});
for (const episode of EPISODES) {
  const suffix = EPISODES.length > 1 ? `: ${episode.policy}` : "";
  const lines = (of) =>
    episode.nodes.map((_, node) => ({
      values: Array.from({ length: episode.slots + 1 }, (__, place) => of(place, node)), thin: true,
    }));
  const shared = { seek: (place) => { play(false); seek(place); } };
  nodeCharts.push({
    episode,
    ages: new Chart(charts, {
      ...shared, title: `Age of every node, slots${suffix}`, lines: lines((p, n) => episode.age(p, n)),
      top: roundAbove(highest(EPISODES.flatMap((each) => each.ages))), text: (value) => decimals(value, 0),
    }),
    energies: new Chart(charts, {
      ...shared, title: `Energy stored in every node${suffix}`, lines: lines((p, n) => episode.energy(p, n)),
      top: roundAbove(highest(EPISODES.flatMap((each) => each.energies))), text: energyText,
    }),
  });
}

const batteryCharts = EPISODES.filter((episode) => episode.battery).map((episode) => ({
  episode,
  chart: new Chart(charts, {
    title: `Battery of every AUV, %${EPISODES.length > 1 ? `: ${episode.policy}` : ""}`,
    lines: Array.from({ length: episode.auvs }, (_, auv) => ({
      values: Array.from({ length: episode.slots + 1 }, (__, place) => 100 * episode.charge(place, auv)),
      colour: auvColour(episode, auv),
    })),
    top: 100, text: (value) => decimals(value, 0),
    seek: (place) => { play(false); seek(place); },
  }),
}));

function showCurves(place) {
  for (const { episode, chart } of batteryCharts) {
    const own = within(episode, place);
    const shares = Array.from({ length: episode.auvs }, (_, auv) => 100 * episode.charge(own, auv));
    const dots = shares.map((value, auv) => ({ value, colour: auvColour(episode, auv) }));
    chart.show(time, dots, episode.auvs > 1 ? "" : decimals(shares[0], 0));
  }

  meanChart.show(
    time,
    EPISODES.map((episode, i) => ({ value: episode.meanAges[within(episode, place)], colour: LINE_LOOKS[i].colour })),
    EPISODES.map((episode) => decimals(episode.meanAges[within(episode, place)], 2)).join(" and ")
  );
  for (const { episode, ages, energies } of nodeCharts) {
    const own = within(episode, place), has = chosen >= 0;
    const age = has && episode.age(own, chosen), energy = has && episode.energy(own, chosen);
    const name = has ? `node ${chosen + 1}: ` : "";
    ages.show(time, has ? [{ value: age, colour: "var(--data)" }] : [], has ? `${name}${ageText(age)}` : "");
    energies.show(time, has ? [{ value: energy, colour: "var(--energy)" }] : [], has ? `${name}${energyText(energy)}` : "");
  }
}

setTheme(root.dataset.theme);
new ResizeObserver(drawTicks).observe(find(".ticks"));
choose(-1);
