// The grid from above and from the side, as SVG.

const SVG = "http://www.w3.org/2000/svg";

function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** The part of a ring around (0, 0) that a share of it fills, clockwise from the top. */
function arc(radius, share) {
  if (share >= 0.999) share = 0.999;
  const angle = 2 * Math.PI * share;
  const x = radius * Math.sin(angle), y = -radius * Math.cos(angle);
  return `M0 ${-radius}A${radius} ${radius} 0 ${share > 0.5 ? 1 : 0} 1 ${x} ${y}`;
}

/** What stands beside a node that sleeps. */
const MOON = "M2-6A6 6 0 1 0 6 3A5 5 0 0 1 2-6z";
/** Size of a node's number relative to its radius, by the number of digits. */
const DIGITS = [0.95, 0.85, 0.6, 0.45];
const ROUND_STEPS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
const stepFrom = (least) => ROUND_STEPS.find((step) => step >= least) ?? Math.ceil(least);

class Flat {
  /**
   * @param host element that takes the picture.
   * @param episode what is shown.
   * @param axes the grid's axes to the right and up (or down) the picture.
   * @param up whether the second one grows upwards.
   * @param view what the episode calls it, where it says places of nodes and edges of cells.
   * @param name what the picture is called.
   */
  constructor(host, episode, axes, up, view, name, pick) {
    Object.assign(this, { episode, axes, up, places: episode.places[view] });
    const edges = episode.edges[view];
    const [columns, rows] = axes.map((axis) => episode.grid[axis]);
    this.px = 400 / Math.max(columns * edges[0], 6); // units of the shorter edge of a cell
    this.across = edges[0] * this.px;
    this.along = edges[1] * this.px;
    const width = columns * this.across, height = rows * this.along;
    this.height = height;
    const left = 26, below = 22;
    this.root = svg("svg", {
      viewBox: `${-left} -6 ${width + left + 6} ${height + below + 6}`, role: "img",
      "aria-label": name,
    });
    this.root.append(svg("rect", { width, height, class: "water" }));
    this.drawAxes(columns, rows, width, height);
    this.drawDocks();
    this.links = svg("g");
    this.nodes = svg("g");
    this.auvs = svg("g");
    this.root.append(this.links, this.nodes, this.auvs);
    this.marks = episode.nodes.map((_, i) => this.addNode(i, pick));
    host.append(this.root);
  }

  drawDocks() {
    const { across, along, axes } = this;
    for (const dock of this.episode.docks ?? []) {
      const [x, y] = [this.x(dock[axes[0]]) - across / 2, this.y(dock[axes[1]]) - along / 2];
      this.root.append(svg("rect", { x, y, width: across, height: along, class: "dock" }, svg("title", {}, "dock")));
    }
  }

  drawAxes(columns, rows, width, height) {
    const { across, along } = this;
    let way = "";
    for (let i = 0; i <= columns; i += stepFrom(9 / across)) way += `M${i * across} 0V${height}`;
    for (let i = 0; i <= rows; i += stepFrom(9 / along)) way += `M0 ${i * along}H${width}`;
    this.root.append(svg("path", { d: way, class: "grid" }));
    const text = (x, y, words, anchor) =>
      this.root.append(svg("text", { x, y, "text-anchor": anchor, class: "axis" }, words));
    for (let i = 1; i <= columns; i += stepFrom(30 / across)) text(this.x(i), height + 15, i, "middle");
    for (let i = 1; i <= rows; i += stepFrom(30 / along)) text(-7, this.y(i) + 4, i, "end");
    text(width - 2, height + 15, "xyz"[this.axes[0]], "end");
    const end = this.up ? 10 : height - 2;
    this.root.append(svg("text", { x: -18, y: end, class: "axis" }, "xyz"[this.axes[1]]));
  }

  x = (cells) => (cells - 0.5) * this.across;
  y = (cells) => (this.up ? this.height - (cells - 0.5) * this.along : (cells - 0.5) * this.along);

  addNode(index, pick) {
    const [x, y, radius] = this.places[index], size = radius * this.px;
    const group = svg("g", { class: "mark", transform: `translate(${this.x(x)} ${this.y(y)})` });
    const chosen = svg("circle", { r: size + 4, class: "chosen" });
    const track = svg("circle", { r: size * 0.87, class: "track", "stroke-width": size * 0.26 });
    const ring = svg("path", { class: "ring", "stroke-width": size * 0.26 });
    const disc = svg("circle", { r: size * 0.74, class: "disc" });
    const number = String(index + 1);
    const letters = svg(
      "text",
      { class: "number", "font-size": size * DIGITS[Math.min(number.length, 4) - 1], dy: "0.36em" },
      number
    );
    const hint = svg("title");
    // A finger is wider than a node.
    const reach = svg("circle", { r: Math.max(size, 16), class: "reach" });
    const moon = svg("path", {
      d: MOON, class: "moon", transform: `translate(${-0.95 * size - 3} ${-0.95 * size - 3})`,
    });
    group.append(hint, chosen, track, ring, disc, letters, moon, reach);
    group.addEventListener("click", () => pick(index));
    this.nodes.append(group);
    return { group, ring, disc, letters, hint, radius: size * 0.87 };
  }

  /** Where an AUV is at a time: in cells of the picture. */
  auvAt(time, auv) {
    const episode = this.episode, place = Math.ceil(time);
    const from = episode.spot(Math.max(place - 1, 0), auv), to = episode.spot(place, auv);
    const done = place ? Math.min((time - place + 1) / CHARGE_FROM, 1) : 1;
    const eased = done * done * (3 - 2 * done);
    const [x, y] = this.axes.map((axis) => from[axis] + (to[axis] - from[axis]) * eased);
    const here = (cell) => this.axes.every((axis) => cell[axis] === to[axis]);
    let raised = episode.nodes.some(here) ? 0.38 * eased : 0;
    for (let other = 0; other < auv; other++) if (here(episode.spot(place, other))) raised -= 0.34;
    return [this.x(x), this.y(y) - raised * this.px];
  }

  show(time, chosen) {
    const episode = this.episode;
    time = Math.min(time, episode.slots);
    const place = Math.ceil(time), share = place ? time - place + 1 : 1;
    const seen = share > 0.8 ? place : Math.max(place - 1, 0);
    this.marks.forEach((mark, i) => {
      const age = episode.age(seen, i), colour = ageColour(age, episode.max_age);
      const gauge = episode.gauge(seen, i);
      mark.disc.setAttribute("fill", css(colour));
      mark.letters.setAttribute("fill", isBright(colour) ? "#22303c" : "#fff");
      mark.ring.setAttribute("d", gauge > 0.001 ? arc(mark.radius, gauge) : "");
      mark.group.classList.toggle("is-chosen", i === chosen);
      const sleeps = episode.sleeps(seen, i);
      mark.group.classList.toggle("sleeps", sleeps);
      mark.hint.textContent =
        `node ${i + 1}: age ${ageText(age)} slots, ${energyText(episode.energy(seen, i))} stored${sleeps ? ", asleep" : ""}`;
    });
    this.showTrails(time, place);
    this.showCourses(time, place);
    if (place && share > CHARGE_FROM) this.addLinks(time, place - 1, share > UPLINK_FROM);
    this.showAuvs(time, place, seen);
  }

  /** A dotted line from each AUV under way to the cell that it goes to. */
  showCourses(time, place) {
    for (let auv = 0; auv < this.episode.auvs; auv++) {
      if (!this.episode.slotsLeft(place, auv)) continue;
      const cell = this.episode.target(place, auv), stroke = auvColour(this.episode, auv);
      const [x, y] = [this.x(cell[this.axes[0]]), this.y(cell[this.axes[1]])];
      this.links.append(
        svg("path", { d: `M${this.auvAt(time, auv)}L${x} ${y}`, class: "course", stroke }),
        svg("circle", { cx: x, cy: y, r: 5, class: "target", stroke })
      );
    }
  }

  showTrails(time, place) {
    this.links.replaceChildren();
    for (let auv = 0; auv < this.episode.auvs; auv++) {
      const points = [];
      for (let i = Math.max(place - LOOK.trail, 0); i < place; i++) {
        const cell = this.episode.spot(i, auv);
        points.push([this.x(cell[this.axes[0]]), this.y(cell[this.axes[1]])]);
      }
      points.push(this.auvAt(time, auv));
      for (let i = 1; i < points.length; i++) {
        this.links.append(
          svg("path", {
            d: `M${points[i - 1]}L${points[i]}`, class: "trail", stroke: auvColour(this.episode, auv),
            opacity: 0.12 + (0.6 * i) / points.length,
          })
        );
      }
    }
  }

  addLinks(time, slot, withUplinks) {
    const at = (node) => [this.x(this.places[node][0]), this.y(this.places[node][1])];
    const add = (kind, from, to) =>
      this.links.append(svg("path", { d: `M${from}L${to}`, class: kind }));
    const links = this.episode.links(slot);
    for (const link of links) {
      if (link.charged >= 0) add("charging", this.auvAt(time, link.auv), at(link.charged));
    }
    for (const link of withUplinks ? this.episode.uplinks(slot) : []) {
      const from = at(link.heard), to = this.auvAt(time, link.auv);
      add(link.arrived ? "packet" : "loss", from, to);
      const way = [to[0] - from[0], to[1] - from[1]];
      if (Math.hypot(...way) < 26) continue; // no room for a symbol
      const angle = (Math.atan2(way[1], way[0]) * 180) / Math.PI;
      const middle = `translate(${from[0] + way[0] / 2} ${from[1] + way[1] / 2})`;
      this.links.append(
        link.arrived
          ? svg("path", { d: "M-5-6L7 0L-5 6z", class: "head", transform: `${middle} rotate(${angle})` })
          : svg("path", { d: "M-5-5L5 5M5-5L-5 5", class: "cross", transform: middle })
      );
    }
  }

  showAuvs(time, place, seen) {
    this.auvs.replaceChildren();
    const size = Math.max(this.px * 0.9, 22);
    for (let auv = 0; auv < this.episode.auvs; auv++) {
      const [x, y] = this.auvAt(time, auv);
      const group = svg("g", { transform: `translate(${x} ${y})` });
      const isStranded = place && this.episode.isStranded(place - 1, auv);
      const fill = isStranded ? LOOK.failed : auvColour(this.episode, auv);
      group.append(svg("path", { d: LOOK.hull, transform: `scale(${size})`, class: "hull", fill }));
      if (this.episode.battery && this.up) group.append(...this.battery(seen, auv, size));
      if (this.episode.auvs > 1) {
        group.append(
          svg("text", { class: "number", "font-size": size * 0.34, dy: "0.36em", fill: "#fff" }, auvName(auv))
        );
      }
      this.auvs.append(group);
    }
  }

  /** A bar above an AUV, as full as its battery. */
  battery(place, auv, size) {
    const share = this.episode.charge(place, auv), width = 0.9 * size;
    const at = { x: -width / 2, y: -0.22 * size - 6, height: 5 };
    const isLow = share <= LOOK.low;
    return [
      svg("rect", { ...at, width, class: "cell" }),
      svg("rect", { ...at, width: share * width, fill: isLow ? LOOK.failed : LOOK.energy }),
    ];
  }
}

/** The colour of an AUV, as CSS. */
const auvColour = (episode, auv) =>
  episode.auvs > 1 ? LOOK.auvs[auv % LOOK.auvs.length] : "var(--auv)";
