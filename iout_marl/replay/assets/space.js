// The grid in space, by three.js: x to the right, y away from the viewer, depth downwards.

const SPAN = 10; // units of the longest edge of the grid
const CHARGE_FROM = 0.45; // share of a slot after which AUVs have arrived, and sound is heard
const UPLINK_FROM = 0.55;

/** Colours of the page's theme. */
function themeColours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue("--" + name).trim();
  return Object.fromEntries(
    ["water", "deep", "floor", "dock", "lines", "ink", "muted", "halo", "auv", "page"].map((n) => [n, of(n)])
  );
}

/** A word on a small board that always looks at the viewer. */
function board(text, size, colour, ground) {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
  const font = "600 44px system-ui, 'DejaVu Sans', sans-serif";
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 28;
  canvas.height = 60;
  pen.font = font;
  if (ground) {
    pen.fillStyle = ground;
    pen.beginPath();
    pen.roundRect(0, 0, canvas.width, canvas.height, 18);
    pen.fill();
  }
  pen.fillStyle = colour;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(text, canvas.width / 2, canvas.height / 2 + 3);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
  sprite.scale.set((size * canvas.width) / canvas.height, size, 1);
  return sprite;
}

class Space {
  /**
   * @param host element that takes the picture.
   * @param episode what is shown.
   * @param pick called with a node that is clicked.
   */
  constructor(host, episode, pick) {
    this.host = host;
    this.episode = episode;
    const drawn = episode.grid.map((cells, axis) => cells * episode.edges.space[axis]);
    this.unit = SPAN / Math.max(...drawn); // of the shortest edge of a cell
    this.edges = episode.edges.space.map((edge) => edge * this.unit);
    this.size = drawn.map((side) => side * this.unit);
    // Nodes of a wide grid are larger than a cell, lest they vanish.
    const crowd = Math.min(Math.max(Math.sqrt(16 / episode.nodes.length), 0.6), 1);
    this.radius = Math.max(0.3 * this.unit, 0.17) * crowd;
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.canvas = this.renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    host.append(this.canvas);
    this.camera = new THREE.PerspectiveCamera(26, 1, 0.1, 400);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.enablePan = false;
    this.controls.maxPolarAngle = 0.56 * Math.PI;
    this.controls.addEventListener("change", () => this.request());
    this.controls.addEventListener("start", () => (this.isWhole = false));
    this.canvas.style.touchAction = "pan-y"; // a finger that moves up scrolls the page
    // The wheel scrolls the page, unless the view has been chosen or a key is held.
    this.canvas.addEventListener("wheel", (event) => {
      const wanted = event.ctrlKey || document.activeElement === this.canvas;
      if (!wanted) event.stopImmediatePropagation();
    }, { capture: true, passive: true });
    this.listenForClicks(pick);
    this.place = 0;
    this.chosen = -1;
    this.build();
    this.look();
    new ResizeObserver(() => this.resize()).observe(host);
    this.resize();
  }

  listenForClicks(pick) {
    let down = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]));
    this.canvas.addEventListener("pointerup", (event) => {
      if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 6) return;
      const box = this.canvas.getBoundingClientRect();
      // The nearest on the screen, within a finger's breadth.
      let best = 24, found = -1;
      this.nodes.forEach((node, i) => {
        const at = node.ball.getWorldPosition(new THREE.Vector3()).project(this.camera);
        const x = ((at.x + 1) / 2) * box.width + box.left;
        const y = ((1 - at.y) / 2) * box.height + box.top;
        const off = Math.hypot(event.clientX - x, event.clientY - y);
        if (off < best) [best, found] = [off, i];
      });
      if (found >= 0) pick(found);
    });
  }

  /** Where the middle of a cell is, cells counted from 1. */
  at([x, y, z]) {
    const [nx, ny, nz] = this.episode.grid, [ex, ey, ez] = this.edges;
    return new THREE.Vector3(
      (x - (nx + 1) / 2) * ex, ((nz + 1) / 2 - z) * ez, ((ny + 1) / 2 - y) * ey
    );
  }

  build() {
    const theme = (this.theme = themeColours());
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(theme.water);
    this.scene.add(new THREE.HemisphereLight(0xffffff, new THREE.Color(theme.deep), 2.4));
    const sun = new THREE.DirectionalLight(0xffffff, 1.3);
    sun.position.set(4, 12, 6);
    this.scene.add(sun);
    this.buildWater();
    for (const dock of this.episode.docks ?? []) this.buildDock(dock);
    this.nodes = this.episode.nodes.map((cell, i) => this.buildNode(cell, i));
    this.auvs = Array.from({ length: this.episode.auvs }, (_, i) => this.buildAuv(i));
    this.moving = new THREE.Group();
    this.scene.add(this.moving);
  }

  buildWater() {
    const [nx, ny] = this.episode.grid, [ex, ey] = this.edges, theme = this.theme;
    const [w, d, h] = this.size;
    const plane = (colour, opacity, y) => {
      const material = new THREE.MeshBasicMaterial({
        color: colour, transparent: opacity < 1, opacity, side: THREE.DoubleSide, depthWrite: false,
      });
      const mesh = new THREE.Mesh(new THREE.PlaneGeometry(w, d), material);
      mesh.rotation.x = -Math.PI / 2;
      mesh.position.y = y;
      mesh.renderOrder = -1;
      this.scene.add(mesh);
    };
    plane(theme.floor, 1, -h / 2);
    plane(theme.deep, 0.1, h / 2);
    const points = [];
    const line = (...ends) => points.push(...ends);
    const every = Math.ceil(Math.max(nx, ny) / 20);
    for (let x = 0; x <= nx; x += every) {
      line(x * ex - w / 2, -h / 2, -d / 2, x * ex - w / 2, -h / 2, d / 2);
    }
    for (let y = 0; y <= ny; y += every) {
      line(-w / 2, -h / 2, d / 2 - y * ey, w / 2, -h / 2, d / 2 - y * ey);
    }
    for (const x of [-w / 2, w / 2]) {
      for (const z of [-d / 2, d / 2]) line(x, -h / 2, z, x, h / 2, z);
      line(x, h / 2, -d / 2, x, h / 2, d / 2);
    }
    for (const z of [-d / 2, d / 2]) line(-w / 2, h / 2, z, w / 2, h / 2, z);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    this.scene.add(
      new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: theme.lines }))
    );
    const note = (text, x, y, z) => {
      const sprite = board(text, 0.42, theme.muted);
      sprite.position.set(x, y, z);
      this.scene.add(sprite);
    };
    note("x →", 0, -h / 2, d / 2 + 0.5);
    note("y →", w / 2 + 0.6, -h / 2, 0);
    note("surface", -w / 2, h / 2 + 0.3, -d / 2);
    note("sea floor", -w / 2 + 1.1, -h / 2 + 0.3, d / 2);
  }

  /** A frame around the cell of a dock, and a platform in it. */
  buildDock(cell) {
    const [ex, ey, ez] = this.edges, group = new THREE.Group();
    const [x, y, z] = [ex / 2, ez / 2, ey / 2];
    for (const level of [-y, y]) {
      const around = [-x, level, -z, x, level, -z, x, level, z, -x, level, z, -x, level, -z];
      this.addLine(group, around, this.theme.halo);
    }
    for (const [a, b] of [[-x, -z], [-x, z], [x, -z], [x, z]]) {
      this.addLine(group, [a, -y, b, a, y, b], this.theme.halo);
    }
    const material = new THREE.MeshBasicMaterial({
      color: this.theme.dock, transparent: true, opacity: 0.75, side: THREE.DoubleSide, depthWrite: false,
    });
    const platform = new THREE.Mesh(new THREE.PlaneGeometry(ex, ey), material);
    platform.rotation.x = -Math.PI / 2;
    platform.position.y = -ez / 2;
    group.position.copy(this.at(cell));
    group.add(platform);
    this.scene.add(group);
  }

  buildNode(cell, index) {
    const { scene, theme, radius } = this, at = this.at(cell);
    const group = new THREE.Group();
    group.position.copy(at);
    const colour = new THREE.MeshLambertMaterial();
    const ball = new THREE.Mesh(new THREE.SphereGeometry(radius, 24, 16), colour);
    const rim = new THREE.MeshBasicMaterial({ color: theme.halo, side: THREE.BackSide });
    const halo = new THREE.Mesh(new THREE.SphereGeometry(radius * 1.13, 24, 16), rim);
    group.add(ball, halo);
    // The gauge of energy: a bar in a tube.
    const height = 3.2 * radius, thick = 0.34 * radius;
    const tube = new THREE.Mesh(
      new THREE.BoxGeometry(thick * 1.5, height, thick * 1.5),
      new THREE.MeshBasicMaterial({ color: theme.halo, transparent: true, opacity: 0.28, depthWrite: false })
    );
    const bar = new THREE.Mesh(
      new THREE.BoxGeometry(thick, 1, thick), new THREE.MeshBasicMaterial({ color: LOOK.energy })
    );
    tube.position.set(1.75 * radius, height / 2 - radius, 0);
    bar.position.x = tube.position.x;
    group.add(tube, bar);
    const label = board(String(index + 1), 1.55 * radius + 0.06, theme.ink);
    label.position.set(-0.4 * radius, 1.9 * radius, 0);
    group.add(label);
    // What floats above the floor is moored to it.
    const floor = -this.size[2] / 2 - at.y;
    this.addLine(group, [0, 0, 0, 0, floor, 0], theme.lines);
    scene.add(group);
    const moon = board("☾", 1.3 * radius + 0.06, theme.ink);
    moon.position.set(-1.5 * radius, 1.1 * radius, 0);
    moon.visible = false;
    group.add(moon);
    return { group, ball, halo, bar, height, colour, moon };
  }

  addLine(parent, points, colour, opacity = 1) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    const material = new THREE.LineBasicMaterial({
      color: colour, transparent: opacity < 1, opacity,
    });
    const line = new THREE.Line(geometry, material);
    parent.add(line);
    return line;
  }

  auvColour(index) {
    return this.episode.auvs > 1 ? LOOK.auvs[index % LOOK.auvs.length] : this.theme.auv;
  }

  buildAuv(index) {
    const size = Math.max(0.78 * this.unit, 0.7), colour = this.auvColour(index);
    const skin = new THREE.MeshLambertMaterial({ color: colour });
    const body = new THREE.Group();
    const part = (geometry, x, y = 0, z = 0) => {
      const mesh = new THREE.Mesh(geometry, skin);
      mesh.position.set(x, y, z);
      body.add(mesh);
      return mesh;
    };
    part(new THREE.CapsuleGeometry(0.2 * size, 0.72 * size, 6, 18), 0).rotation.z = Math.PI / 2;
    part(new THREE.ConeGeometry(0.16 * size, 0.34 * size, 18), -0.62 * size).rotation.z = -Math.PI / 2;
    part(new THREE.BoxGeometry(0.2 * size, 0.6 * size, 0.04 * size), -0.62 * size);
    part(new THREE.BoxGeometry(0.2 * size, 0.04 * size, 0.6 * size), -0.62 * size);
    part(new THREE.BoxGeometry(0.16 * size, 0.26 * size, 0.06 * size), 0.08 * size, 0.24 * size);
    const group = new THREE.Group();
    group.add(body);
    if (this.episode.auvs > 1) {
      const tag = board(auvName(index), 0.5, "#fff", colour);
      tag.position.y = 0.62 * size + (this.episode.battery ? 0.3 : 0);
      group.add(tag);
    }
    const drop = this.addLine(group, [0, 0, 0, 0, -1, 0], colour, 0.45);
    const battery = this.episode.battery ? this.buildBattery(group, size) : null;
    this.scene.add(group);
    return { group, body, drop, battery, skin, colour, heading: 0 };
  }

  /** A bar above an AUV that always looks at the viewer; how to fill it. */
  buildBattery(group, size) {
    const width = 1.1 * size, height = 0.16 * size;
    const canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
    [canvas.width, canvas.height] = [176, 32];
    const map = new THREE.CanvasTexture(canvas);
    map.colorSpace = THREE.SRGBColorSpace;
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
    sprite.scale.set(width, height * 1.25, 1);
    sprite.position.y = 0.42 * size;
    group.add(sprite);
    let shown = -1;
    return (share) => {
      if (share === shown) return;
      shown = share;
      pen.fillStyle = this.theme.halo;
      pen.fillRect(0, 0, canvas.width, canvas.height);
      pen.fillStyle = this.theme.page;
      pen.fillRect(4, 4, canvas.width - 8, canvas.height - 8);
      pen.fillStyle = share <= LOOK.low ? LOOK.failed : LOOK.energy;
      pen.fillRect(4, 4, share * (canvas.width - 8), canvas.height - 8);
      map.needsUpdate = true;
    };
  }

  /** Where an AUV is at a time; AUVs of one cell lie side by side, and above its node. */
  auvAt(time, auv) {
    const episode = this.episode, place = Math.min(Math.ceil(time), episode.slots);
    const from = episode.spot(Math.max(place - 1, 0), auv), to = episode.spot(place, auv);
    const done = place ? Math.min((time - place + 1) / CHARGE_FROM, 1) : 1;
    const eased = done * done * (3 - 2 * done);
    const at = this.at(from).lerp(this.at(to), eased);
    const shared = (cell, other) => other.every((value, i) => value === cell[i]);
    if (episode.nodes.some((node) => shared(to, node))) at.y += eased * 2.1 * this.radius;
    for (let other = 0; other < auv; other++) {
      if (shared(to, episode.spot(place, other))) at.z += 0.6 * this.radius + 0.3;
    }
    return at;
  }

  /** Show the episode at a time: whole numbers are the ends of slots. */
  show(time, chosen) {
    const episode = this.episode;
    time = Math.min(time, episode.slots);
    this.time = time;
    const place = Math.ceil(time), share = place ? time - place + 1 : 1;
    this.place = place;
    const seen = share > 0.8 ? place : Math.max(place - 1, 0);
    this.nodes.forEach((node, i) => {
      node.colour.color.setRGB(
        ...ageColour(episode.age(seen, i), episode.max_age), THREE.SRGBColorSpace
      );
      const gauge = episode.gauge(seen, i) * node.height;
      node.bar.visible = gauge > 0;
      node.bar.scale.y = Math.max(gauge, 1e-3);
      node.bar.position.y = gauge / 2 - this.radius;
      node.moon.visible = episode.sleeps(seen, i);
      node.halo.material.color.set(i === chosen ? LOOK.chosen : this.theme.halo);
      node.halo.scale.setScalar(i === chosen ? 1.22 : 1);
    });
    this.clear(this.moving);
    this.auvs.forEach((auv, i) => {
      const at = this.auvAt(time, i);
      auv.group.position.copy(at);
      const from = episode.spot(Math.max(place - 1, 0), i), to = episode.spot(place, i);
      const east = to[0] - from[0], north = to[1] - from[1];
      if (east || north) auv.heading = Math.atan2(north, east);
      auv.body.rotation.y = auv.heading;
      auv.drop.scale.y = Math.max(at.y + this.size[2] / 2, 1e-3);
      const isStranded = place > 0 && episode.isStranded(place - 1, i);
      auv.skin.color.set(isStranded ? LOOK.failed : auv.colour);
      auv.battery?.(episode.charge(seen, i));
      this.addTrail(i, at, place);
      if (episode.slotsLeft(place, i)) this.addCourse(i, at, place);
    });
    if (place && share > CHARGE_FROM) this.addLinks(place - 1, share);
    this.request();
  }

  addTrail(auv, at, place) {
    const points = [], first = Math.max(place - LOOK.trail, 0);
    for (let i = first; i < place; i++) points.push(this.at(this.episode.spot(i, auv)));
    points.push(at);
    const colour = this.auvColour(auv);
    for (let i = 1; i < points.length; i++) {
      const width = 0.042 * (0.35 + (0.65 * i) / points.length);
      this.addRod(points[i - 1], points[i], width, colour, 0.15 + (0.6 * i) / points.length);
    }
  }

  /** Dots from an AUV under way to the cell that it goes to. */
  addCourse(auv, at, place) {
    const way = this.at(this.episode.target(place, auv)).sub(at), dots = Math.ceil(way.length() / 0.2);
    const part = (share) => at.clone().addScaledVector(way, share / dots);
    for (let i = 0; i < dots; i++) this.addRod(part(i), part(i + 0.45), 0.03, this.auvColour(auv), 0.8);
  }

  /** A straight rod between two points; with two widths it is a cone. */
  addRod(from, to, width, colour, opacity = 1, end = width) {
    const way = to.clone().sub(from), length = way.length();
    if (length < 1e-6) return;
    const material = new THREE.MeshBasicMaterial({
      color: colour, transparent: opacity < 1, opacity, depthWrite: opacity === 1,
    });
    const rod = new THREE.Mesh(new THREE.CylinderGeometry(end, width, length, 12, 1, true), material);
    rod.position.copy(from).addScaledVector(way, 0.5);
    rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.divideScalar(length));
    this.moving.add(rod);
  }

  addLinks(slot, share) {
    const radius = this.radius;
    for (const link of this.episode.links(slot)) {
      const auv = this.auvAt(this.time, link.auv);
      if (link.charged >= 0) {
        const node = this.at(this.episode.nodes[link.charged]);
        const grown = Math.min((share - CHARGE_FROM) / 0.2, 1);
        const end = auv.clone().lerp(node, grown);
        this.addRod(auv, end, 0.07, LOOK.energy, 0.42, (0.07 + 0.8 * radius * grown));
        this.addRod(auv, end, 0.025, LOOK.energy, 0.9);
      }
    }
    if (share <= UPLINK_FROM) return;
    for (const link of this.episode.uplinks(slot)) {
      this.addUplink(link, this.auvAt(this.time, link.auv), Math.min((share - UPLINK_FROM) / 0.3, 1));
    }
  }

  addUplink(link, auv, grown) {
    const node = this.at(this.episode.nodes[link.heard]);
    const end = node.clone().lerp(auv, link.arrived ? grown : Math.min(grown, 1));
    const way = end.clone().sub(node), length = way.length();
    if (link.arrived) {
      this.addRod(node, end, 0.055, LOOK.data);
      if (length > 0.7) {
        const unit = way.clone().normalize();
        const tip = node.clone().addScaledVector(way, 0.5);
        this.addRod(tip.clone().addScaledVector(unit, -0.22), tip.addScaledVector(unit, 0.22), 0.17, LOOK.data, 1, 0);
      }
      return;
    }
    const dashes = Math.max(Math.round(length / 0.45), 1);
    for (let i = 0; i < dashes; i++) {
      const part = (share) => node.clone().addScaledVector(way, share / dashes);
      this.addRod(part(i), part(i + 0.55), 0.05, LOOK.failed);
    }
    const cross = board("✕", 0.62, "#fff", LOOK.failed);
    cross.position.copy(node).addScaledVector(way, 0.5);
    this.moving.add(cross);
  }

  clear(group) {
    for (const child of group.children) {
      if (child.geometry && !child.isSprite) child.geometry.dispose();
      child.material.map?.dispose();
      child.material.dispose();
    }
    group.clear();
  }

  /** Look at the whole grid from the right front, or as it was turned to. */
  look(direction = new THREE.Vector3(0.5, 0.5, 1)) {
    const { camera, controls } = this, size = this.size.map((side) => side / 2);
    const corners = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => [-1, 1].map((z) =>
      new THREE.Vector3(x * (size[0] + 0.3), y * (size[2] + 0.35), z * (size[1] + 0.35)))));
    const away = direction.clone().normalize(), target = new THREE.Vector3();
    const tangent = Math.tan((camera.fov * Math.PI) / 360);
    let distance = 4 * SPAN;
    // Nearer, and aside, until its corners just fill the picture.
    for (let round = 0; round < 12; round++) {
      camera.position.copy(target).addScaledVector(away, distance);
      camera.lookAt(target);
      camera.updateMatrixWorld();
      const seen = corners.map((corner) => corner.clone().project(camera));
      const [x, y] = ["x", "y"].map((axis) => seen.map((corner) => corner[axis]));
      const ends = [x, y].map((values) => [Math.min(...values), Math.max(...values)]);
      const [right, up] = [0, 1].map((i) => new THREE.Vector3().setFromMatrixColumn(camera.matrix, i));
      const middle = ends.map(([low, high]) => ((low + high) / 2) * distance * tangent);
      target.addScaledVector(right, middle[0] * camera.aspect).addScaledVector(up, middle[1]);
      distance *= Math.max(...ends.map(([low, high]) => (high - low) / 2)) / 0.94;
    }
    camera.position.copy(target).addScaledVector(away, distance);
    controls.target.copy(target);
    controls.update();
    this.isWhole = true;
    this.request();
  }

  /** Turn around the vertical axis and tilt, by angles in degrees, and zoom. */
  turn(across, along, zoom = 1) {
    const { target } = this.controls, offset = this.camera.position.clone().sub(target);
    const at = new THREE.Spherical().setFromVector3(offset);
    at.theta += (across * Math.PI) / 180;
    at.phi = Math.min(Math.max(at.phi + (along * Math.PI) / 180, 0.02), 1.7);
    at.radius *= zoom;
    offset.setFromSpherical(at);
    if (zoom === 1 && this.isWhole) {
      this.look(offset);
      return;
    }
    this.camera.position.copy(target).add(offset);
    this.controls.update();
    this.isWhole = false;
    this.request();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.isWhole) this.look(this.camera.position.clone().sub(this.controls.target));
    this.request();
  }

  retheme(chosen) {
    this.clearAll();
    this.build();
    this.show(this.time ?? 0, chosen);
  }

  clearAll() {
    this.scene.traverse((part) => {
      if (part.geometry && !part.isSprite) part.geometry.dispose();
      part.material?.map?.dispose();
      part.material?.dispose();
    });
  }

  /** Draw once, with the next picture of the browser. */
  request() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.renderer.render(this.scene, this.camera);
    });
  }
}
