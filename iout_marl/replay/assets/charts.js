// Curves over the slots of an episode, with a cursor where the clock is.

/** The first round number that is not below a positive value. */
function roundAbove(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((step) => step * power >= value * (1 - 1e-9));
}

class Chart {
  /**
   * @param host element that takes it.
   * @param title what it shows, with the unit.
   * @param lines {values, label, colour, dash, thin} of each, values from the first place on.
   * @param top upper end of the axis.
   * @param text how its values are written.
   * @param width units of the picture.
   * @param seek called with a place that is clicked.
   */
  constructor(host, { title, lines, top, text, seek, width: wide = 520 }) {
    this.size = { width: wide, height: 170, left: 46, right: 10, above: 10, below: 24 };
    this.text = text;
    this.top = top;
    this.figure = document.createElement("figure");
    this.figure.className = "chart";
    const caption = document.createElement("figcaption");
    caption.innerHTML = "<h3></h3><p></p>";
    caption.querySelector("h3").textContent = title;
    this.reading = caption.querySelector("p");
    const { width, height } = this.size;
    this.root = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
    this.drawAxes();
    this.lines = lines.map((line) => {
      const path = svg("path", {
        d: this.way(line.values), class: line.thin ? "curve thin" : "curve",
        ...(line.colour ? { style: `stroke:${line.colour}` } : {}),
        ...(line.dash ? { "stroke-dasharray": line.dash } : {}),
      });
      this.root.append(path);
      return path;
    });
    this.bold = svg("path", { class: "curve bold", d: "" });
    this.cursor = svg("path", { class: "cursor", d: `M0 ${this.size.above}V${height - this.size.below}` });
    this.dots = svg("g");
    this.root.append(this.bold, this.cursor, this.dots);
    this.listen(seek);
    this.figure.append(caption, this.root);
    host.append(this.figure);
  }

  x = (place) => {
    const { width, left, right } = this.size;
    return left + (place / SLOTS) * (width - left - right);
  };
  y = (value) => {
    const { height, above, below } = this.size;
    return height - below - (Math.min(value, this.top) / this.top) * (height - above - below);
  };

  drawAxes() {
    const { width, height, left, right, below } = this.size;
    for (const share of [0, 0.5, 1]) {
      const y = this.y(share * this.top);
      this.root.append(
        svg("path", { d: `M${left} ${y}H${width - right}`, class: "grid" }),
        svg("text", { x: left - 6, y: y + 4, "text-anchor": "end", class: "axis" }, this.text(share * this.top))
      );
    }
    const every = stepFrom((SLOTS * 65) / width);
    for (let place = 0; place <= SLOTS; place += every) {
      this.root.append(
        svg("text", { x: this.x(place), y: height - below + 16, "text-anchor": "middle", class: "axis" }, place)
      );
    }
  }

  way(values) {
    return values.map((value, i) => `${i ? "L" : "M"}${this.x(i).toFixed(1)} ${this.y(value).toFixed(1)}`).join("");
  }

  listen(seek) {
    let held = false;
    const go = (event) => {
      const box = this.root.getBoundingClientRect(), { width, left, right } = this.size;
      const across = ((event.clientX - box.left) / box.width) * width;
      const share = (across - left) / (width - left - right);
      seek(Math.round(Math.min(Math.max(share, 0), 1) * SLOTS));
    };
    this.root.addEventListener("pointerdown", (event) => {
      held = true;
      this.root.setPointerCapture(event.pointerId);
      go(event);
    });
    this.root.addEventListener("pointermove", (event) => held && go(event));
    for (const end of ["pointerup", "pointercancel"]) this.root.addEventListener(end, () => (held = false));
  }

  /** Move the cursor; with dots on lines of these values and colours. */
  show(time, dots, reading) {
    this.cursor.setAttribute("transform", `translate(${this.x(time)})`);
    this.dots.replaceChildren(
      ...dots.map(({ value, colour }) =>
        svg("circle", { cx: this.x(time), cy: this.y(value), r: 4, class: "dot", style: `fill:${colour}` })
      )
    );
    this.reading.textContent = reading;
  }

  /** Draw one line in bold. */
  emphasise(values, colour) {
    this.bold.setAttribute("d", values ? this.way(values) : "");
    this.bold.style.stroke = colour ?? "";
    this.root.classList.toggle("has-bold", Boolean(values));
  }
}
