// A robot in motion: bodies, balance, contact, the nearest pair of bodies, margins; with a ghost where there is one.
"use strict";
// Units of joints that slide in place of those of joints that turn.
const OF_SLIDES = { "rad": "m", "rad/s": "m/s", "rad/s²": "m/s²", "rad/s³": "m/s³", "N·m": "N" };
class Replay {
  constructor(holder) {
    this.holder = holder;
    this.robot = excite.island(holder.dataset.replay);
    this.names = holder.dataset.tracks.split(" ");
    this.titles = this.names.map((id) => document.getElementById(id).dataset.title);
    this.tracks = new Map();
    this.clock = 0;
    this.speed = 1;
    this.ready = this.build().catch((error) => {
      this.failed = String(error);
      holder.replaceChildren(excite.make("p", "note", "No moving picture: this browser draws no WebGL. The pictures below stand still."));
      const still = holder.closest(".interactive");
      if (still) still.classList.remove("ready");
    });
    (window.replays = window.replays || []).push(this);
  }

  async build() {
    const holder = this.holder;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1.6, 0.01, 200);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enableZoom = false; // Until it is touched, so that the wheel scrolls the page.
    this.controls.addEventListener("change", () => this.draw());
    const canvas = this.renderer.domElement;
    canvas.style.touchAction = "pan-y";
    canvas.addEventListener("pointerdown", () => (this.controls.enableZoom = true));
    canvas.addEventListener("pointerleave", () => (this.controls.enableZoom = false));
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "the robot moving; drag to look from elsewhere");
    this.layOut(canvas);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8090a0, 1.9));
    this.sun = new THREE.DirectionalLight(0xffffff, 1.6);
    this.sun.position.set(2, -3, 5);
    this.scene.add(this.sun);
    this.outline = [[], ...this.robot.joints.map(() => [])]; // Corners of the boxes around what each joint carries.
    this.body = await this.makeBody(1);
    this.ghost = await this.makeBody(0.3);
    this.ghost.group.visible = false;
    this.makeMarks();
    this.paint();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
    new ResizeObserver(() => this.resize()).observe(this.stage);
    await this.choose(0);
    // Of a single joint without shapes there is nothing to draw; its signals stay.
    this.stage.hidden = !this.robot.bodies.length;
    const still = holder.closest(".interactive");
    if (still) still.classList.add("ready");
    this.look();
  }

  layOut(canvas) {
    const make = excite.make;
    const bar = make("div", "replay-bar");
    this.select = make("select");
    this.select.setAttribute("aria-label", "motion");
    this.titles.forEach((title, i) => {
      const option = make("option", "", title);
      option.value = i;
      this.select.append(option);
    });
    this.select.addEventListener("change", () => this.choose(Number(this.select.value)));
    this.button = make("button", "", "Play");
    this.button.type = "button";
    this.button.addEventListener("click", () => this.play(!this.playing));
    this.scrub = make("input");
    Object.assign(this.scrub, { type: "range", min: 0, max: 1, step: "any", value: 0 });
    this.scrub.setAttribute("aria-label", "time");
    this.scrub.addEventListener("input", () => {
      this.play(false);
      this.show(Number(this.scrub.value));
    });
    this.stamp = make("span", "replay-time", "0.00 s");
    this.pace = make("select");
    this.pace.setAttribute("aria-label", "speed");
    for (const speed of [0.25, 0.5, 1, 2]) {
      const option = make("option", "", speed + " ×");
      option.value = speed;
      option.selected = speed === 1;
      this.pace.append(option);
    }
    this.pace.addEventListener("change", () => (this.speed = Number(this.pace.value)));
    bar.append(this.select, this.button, this.scrub, this.stamp, this.pace);
    this.stage = make("div", "replay-stage");
    this.stage.append(canvas);
    this.legend = make("p", "legend replay-legend");
    this.side = make("div", "replay-margins");
    const main = make("div", "replay-main");
    main.append(this.stage, this.side);
    this.plots = make("div", "replay-plots");
    this.holder.replaceChildren(bar, main, this.legend, this.plots);
  }

  async makeBody(opacity) {
    const group = new THREE.Group();
    const material = new THREE.MeshLambertMaterial({ flatShading: true, side: THREE.DoubleSide, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
    const joints = [new THREE.Group(), ...this.robot.joints.map(() => new THREE.Group())];
    joints.forEach((joint) => {
      joint.matrixAutoUpdate = false;
      group.add(joint);
    });
    for (const part of this.robot.bodies) {
      const [x, y, z] = await excite.unpack(part.corners);
      const corners = new Float32Array(3 * x.length);
      for (let i = 0; i < x.length; i++) corners.set([x[i], y[i], z[i]], 3 * i);
      const [a, b, c] = await excite.unpack(part.triangles);
      const index = new Uint16Array(3 * a.length);
      for (let i = 0; i < a.length; i++) index.set([a[i], b[i], c[i]], 3 * i);
      const ends = [x, y, z].map((column) => [Math.min(...column), Math.max(...column)]);
      for (let k = 0; k < 8; k++) this.outline[part.joint].push(new THREE.Vector3(ends[0][k & 1], ends[1][(k >> 1) & 1], ends[2][k >> 2]));
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(corners, 3));
      geometry.setIndex(new THREE.BufferAttribute(index, 1));
      geometry.computeVertexNormals();
      joints[part.joint].add(new THREE.Mesh(geometry, material));
    }
    this.scene.add(group);
    return { group, joints, material };
  }

  makeMarks() {
    const flat = (points) => new THREE.BufferGeometry().setFromPoints(points);
    const zero = () => new THREE.Vector3();
    const line = () => new THREE.Line(flat([zero(), zero()]), new THREE.LineBasicMaterial({ depthTest: false }));
    const disc = (radius) => new THREE.Mesh(new THREE.SphereGeometry(radius, 16, 10), new THREE.MeshBasicMaterial({ depthTest: false }));
    const closed = () => new THREE.LineLoop(flat([zero(), zero(), zero()]), new THREE.LineBasicMaterial());
    const floating = this.robot.feet.length > 0;
    this.marks = { com: disc(0.018), plumb: line(), zmp: disc(0.014), pair: line(), support: closed() };
    this.area = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.35, side: THREE.DoubleSide, depthWrite: false }));
    this.soles = this.robot.feet.map(() => closed());
    for (const mark of Object.values(this.marks)) mark.renderOrder = 2;
    this.scene.add(...Object.values(this.marks), this.area, ...this.soles);
    for (const name of ["com", "plumb", "zmp", "support"]) this.marks[name].visible = floating;
    this.area.visible = floating;
  }

  paint() {
    const of = (role) => new THREE.Color(excite.color(role));
    this.body.material.color = of("body");
    this.ghost.material.color = of("nominal");
    this.marks.com.material.color = of("nominal");
    this.marks.plumb.material.color = of("nominal");
    this.marks.zmp.material.color = of("identified");
    this.marks.support.material.color = of("true");
    this.area.material.color = of("true");
    if (this.grid) this.scene.remove(this.grid);
    if (this.robot.ground !== null) {
      this.grid = new THREE.GridHelper(4, 16, of("muted"), of("grid"));
      this.grid.rotation.x = Math.PI / 2;
      this.grid.position.z = this.robot.ground - 0.001;
      this.scene.add(this.grid);
    }
    this.draw();
  }

  // Poses of every joint, the world's first, for one configuration.
  poses(q) {
    const world = [new THREE.Matrix4()];
    let at = 0;
    this.robot.joints.forEach((joint) => {
      const place = new THREE.Matrix4().compose(new THREE.Vector3(...joint.xyz), new THREE.Quaternion(...joint.quat).normalize(), new THREE.Vector3(1, 1, 1));
      const move = new THREE.Matrix4();
      if (joint.free) {
        move.compose(new THREE.Vector3(q[at], q[at + 1], q[at + 2]), new THREE.Quaternion(q[at + 3], q[at + 4], q[at + 5], q[at + 6]).normalize(), new THREE.Vector3(1, 1, 1));
        at += 7;
      } else {
        const angle = q[at++];
        move.makeRotationAxis(new THREE.Vector3(...joint.turn), angle);
        if (joint.turn.every((part) => part === 0)) move.identity();
        move.setPosition(new THREE.Vector3(...joint.slide).multiplyScalar(angle));
      }
      world.push(world[joint.parent].clone().multiply(place).multiply(move));
    });
    return world;
  }

  configuration(columns, frame, share) {
    const last = columns[0].length - 1;
    const next = Math.min(frame + 1, last);
    const q = columns.map((column) => column[frame]);
    if (share <= 0 || next === frame) return q;
    const then = columns.map((column) => column[next]);
    // A base's orientation and its negative are one; without a base the same columns are joints.
    if (this.robot.joints[0] && this.robot.joints[0].free) {
      const dot = q[3] * then[3] + q[4] * then[4] + q[5] * then[5] + q[6] * then[6];
      if (dot < 0) for (let i = 3; i < 7; i++) then[i] = -then[i];
    }
    return q.map((value, i) => (1 - share) * value + share * then[i]);
  }

  async choose(number) {
    this.play(false);
    const id = this.names[number];
    if (!this.tracks.has(id)) this.tracks.set(id, await this.read(excite.island(id)));
    this.track = this.tracks.get(id);
    this.select.value = number;
    this.scrub.max = this.track.time[this.track.time.length - 1];
    this.ghost.group.visible = Boolean(this.track.ghost);
    this.explain();
    this.listMargins();
    this.clock = 0;
    this.show(0);
    this.look();
    this.draw();
    this.drawPlots();
  }

  async read(raw) {
    const one = async (block) => (block ? (await excite.unpack(block))[0] : null);
    const all = async (block) => (block ? await excite.unpack(block) : null);
    const track = { name: raw.name, time: await one(raw.time), q: await all(raw.q), com: await all(raw.com), zmp: await all(raw.zmp), contacts: await all(raw.contacts) };
    track.signals = [];
    for (const signal of raw.signals || []) {
      const values = signal.from === undefined ? await all(signal.values) : track.q.slice(signal.from);
      track.signals.push({ ...signal, values, other: await all(signal.other) });
    }
    track.ghost = raw.ghost ? { label: raw.ghost.label, q: await all(raw.ghost.q) } : null;
    track.label = raw.label;
    track.closest = raw.closest ? { joints: await all(raw.closest.joints), points: await all(raw.closest.points) } : null;
    track.margins = [];
    for (const margin of raw.margins || []) {
      track.margins.push({ ...margin, values: await one(margin.values), where: await one(margin.where) });
    }
    return track;
  }

  explain() {
    const item = (role, text) => {
      const span = excite.make("span");
      const swatch = excite.make("i");
      swatch.style.background = "var(--" + role + ")";
      span.append(swatch, text);
      return span;
    };
    const track = this.track;
    const items = [];
    if (track.ghost) items.push(item("body", track.label || "measured"), item("nominal", track.ghost.label + " (transparent)"));
    if (this.robot.feet.length && track.com) {
      items.push(item("true", "support polygon"));
      if (!track.ghost) items.push(item("nominal", "centre of mass and its plumb line"));
    }
    if (track.zmp) items.push(item("identified", "zero-moment point"));
    if (track.closest) items.push(item("ink", "line between the nearest two bodies"));
    if (track.margins.length || track.signals.length) items.push(item("bad", "limits, dashed in the plots"));
    this.legend.replaceChildren(...items);
  }

  listMargins() {
    this.bars = this.track.margins.map((margin) => {
      const box = excite.make("div", "margin");
      const name = excite.make("span", "", margin.title);
      const value = excite.make("span", "margin-value");
      const bar = excite.make("div", "margin-bar");
      const fill = excite.make("i");
      bar.append(fill);
      const where = excite.make("span", "margin-where");
      box.append(name, value, bar, where);
      const known = margin.values.filter(Number.isFinite);
      return { box, value, fill, where, margin, most: Math.max(margin.required, ...known, 1e-9) };
    });
    const heading = excite.make("b", "", "Margins now");
    this.side.replaceChildren(...(this.bars.length ? [heading, ...this.bars.map((bar) => bar.box)] : []));
    this.side.hidden = !this.bars.length;
  }

  show(time) {
    const track = this.track;
    const stamps = track.time;
    const end = stamps[stamps.length - 1];
    this.clock = Math.min(Math.max(time, 0), end);
    let low = 0;
    let high = stamps.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (stamps[middle] <= this.clock) low = middle;
      else high = middle;
    }
    const frame = stamps.length < 2 ? 0 : this.clock >= end ? stamps.length - 1 : low;
    const step = frame + 1 < stamps.length ? stamps[frame + 1] - stamps[frame] : 1;
    const share = frame + 1 < stamps.length ? (this.clock - stamps[frame]) / step : 0;
    this.frame = frame;
    const world = this.pose(this.body, track.q, frame, share);
    if (track.ghost) this.pose(this.ghost, track.ghost.q, frame, share);
    this.balance(world, frame, share);
    this.nearest(world, frame);
    for (const bar of this.bars) {
      const value = bar.margin.values[frame];
      const good = value >= bar.margin.required;
      const place = bar.margin.places[bar.margin.where[frame]] || "";
      bar.value.textContent = excite.number(value) + " " + this.unitAt(bar.margin.unit, place) + (good ? "" : " ✗");
      bar.value.classList.toggle("bad", !good);
      bar.fill.style.width = (100 * Math.min(1, Math.max(0, value / bar.most)) || 0) + "%";
      bar.fill.style.background = good ? "var(--identified)" : "var(--bad)";
      bar.where.textContent = place;
    }
    this.scrub.value = this.clock;
    this.stamp.textContent = this.clock.toFixed(2) + " s";
    this.draw();
  }

  pose(body, columns, frame, share) {
    const world = this.poses(this.configuration(columns, frame, share));
    world.forEach((matrix, i) => {
      body.joints[i].matrix.copy(matrix);
      body.joints[i].matrixWorldNeedsUpdate = true;
    });
    return world;
  }

  balance(world, frame, share) {
    const track = this.track;
    const ground = this.robot.ground === null ? 0 : this.robot.ground;
    if (!this.robot.feet.length) return;
    const standing = [];
    this.robot.feet.forEach((foot, i) => {
      const corners = foot.sole.map((corner) => new THREE.Vector3(...corner).applyMatrix4(world[foot.joint]));
      const loaded = track.contacts && track.contacts[i][frame] > 0.5;
      Replay.reshape(this.soles[i], corners);
      this.soles[i].material.color = new THREE.Color(excite.color(loaded ? "true" : "muted"));
      if (loaded) standing.push(...corners);
    });
    const hull = Replay.hull(standing).map(([x, y]) => new THREE.Vector3(x, y, ground + 0.002));
    this.marks.support.visible = this.area.visible = hull.length > 2;
    if (hull.length > 2) {
      Replay.reshape(this.marks.support, hull);
      const fan = [];
      for (let i = 1; i + 1 < hull.length; i++) fan.push(hull[0], hull[i], hull[i + 1]);
      Replay.reshape(this.area, fan);
    }
    const at = (columns) => columns.map((column) => {
      const next = column[Math.min(frame + 1, column.length - 1)];
      return (1 - share) * column[frame] + share * next;
    });
    if (track.com) {
      const com = new THREE.Vector3(...at(track.com));
      this.marks.com.position.set(com.x, com.y, ground);
      this.marks.plumb.geometry.setFromPoints([com, new THREE.Vector3(com.x, com.y, ground)]);
    }
    this.marks.com.visible = this.marks.plumb.visible = Boolean(track.com);
    this.marks.zmp.visible = false;
    if (track.zmp) {
      const [x, y] = at(track.zmp);
      this.marks.zmp.visible = Number.isFinite(x + y);
      if (this.marks.zmp.visible) this.marks.zmp.position.set(x, y, ground);
    }
  }

  nearest(world, frame) {
    const closest = this.track.closest;
    this.marks.pair.visible = Boolean(closest);
    if (!closest) return;
    const ends = [0, 1].map((i) => {
      const point = closest.points.slice(3 * i, 3 * i + 3).map((column) => column[frame]);
      return new THREE.Vector3(...point).applyMatrix4(world[closest.joints[i][frame]]);
    });
    this.marks.pair.geometry.setFromPoints(ends);
    const bar = this.bars.find((one) => one.margin.name === "self_collision_m");
    const bad = bar && bar.margin.values[frame] < bar.margin.required;
    this.marks.pair.material.color = new THREE.Color(excite.color(bad ? "bad" : "ink"));
  }

  // A geometry keeps the number of its points: for another number it has to be another one.
  static reshape(mark, points) {
    mark.geometry.dispose();
    mark.geometry = new THREE.BufferGeometry().setFromPoints(points);
  }

  // Convex hull on the ground, Andrew's monotone chain.
  static hull(points) {
    const sorted = points.map((p) => [p.x, p.y]).sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (list) => {
      const chain = [];
      for (const p of list) {
        while (chain.length > 1) {
          const [a, b] = chain.slice(-2);
          if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 1e-12) break;
          chain.pop();
        }
        chain.push(p);
      }
      return chain.slice(0, -1);
    };
    return sorted.length < 3 ? [] : [...half(sorted), ...half([...sorted].reverse())];
  }

  play(on) {
    this.playing = on;
    if (!this.button) return;
    this.button.textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (this.clock >= Number(this.scrub.max)) this.clock = 0;
    let before = null;
    const step = (now) => {
      if (!this.playing) return;
      if (before !== null) this.show(this.clock + (this.speed * (now - before)) / 1000);
      before = now;
      if (this.clock >= Number(this.scrub.max)) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // The camera where all of the motion is to be seen, from the front, a little from the left and from above.
  look() {
    const low = new THREE.Vector3(Infinity, Infinity, Infinity);
    const high = new THREE.Vector3(-Infinity, -Infinity, -Infinity);
    const q = this.track.q;
    const count = q[0].length;
    for (let frame = 0; frame < count; frame += Math.max(1, Math.floor(count / 40))) {
      this.poses(this.configuration(q, frame, 0)).forEach((matrix, joint) => {
        for (const corner of this.outline[joint]) {
          const point = corner.clone().applyMatrix4(matrix);
          low.min(point);
          high.max(point);
        }
      });
    }
    if (this.robot.ground !== null) low.z = Math.min(low.z, this.robot.ground);
    if (!Number.isFinite(low.x)) return; // Nothing to be seen.
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const radius = Math.max(0.1, 0.5 * high.distanceTo(low) + 0.06);
    const [azimuth, elevation] = [0.66, 0.22];
    const away = (0.82 * radius) / Math.sin((0.5 * this.camera.fov * Math.PI) / 180) / Math.min(1, this.camera.aspect);
    this.camera.position.set(
      centre.x + away * Math.cos(elevation) * Math.cos(azimuth),
      centre.y + away * Math.cos(elevation) * Math.sin(azimuth),
      centre.z + away * Math.sin(elevation),
    );
    this.controls.target.copy(centre);
    this.controls.update();
  }

  resize() {
    const width = this.stage.clientWidth;
    const height = this.stage.clientHeight;
    if (!width || !height) return;
    const shape = this.camera.aspect;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.track && (shape < 1) !== (this.camera.aspect < 1)) this.look();
    this.draw();
  }

  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      this.renderer.render(this.scene, this.camera);
    });
  }

  // The unit of a joint's quantity: lengths and forces where it slides. Other places keep theirs.
  unitAt(unit, name) {
    const joint = this.robot.joints.find((one) => one.name === name);
    const slides = joint && joint.slide && joint.slide.some((part) => part !== 0);
    return slides ? OF_SLIDES[unit] || unit : unit;
  }

  // Margins and the signals of one joint against its limits, under one cursor.
  drawPlots() {
    for (const plot of this.drawn || []) {
      excite.plots.delete(plot);
      plot.destroy();
    }
    this.drawn = [];
    this.plots.replaceChildren();
    const track = this.track;
    if (!window.uPlot) return;
    const group = "replay-" + this.names.indexOf(this.names.find((id) => this.tracks.get(id) === track));
    const grid = excite.make("div", "plots");
    const add = (into, spec) => {
      const box = excite.make("div", "plot");
      box.append(excite.make("div", "plot-title", spec.title));
      into.append(box);
      const plot = excite.plot(box, spec, track.time, group);
      // A click on a plot takes the replay there; a drag zooms.
      plot.over.addEventListener("click", () => {
        if (plot.cursor.idx === null) return;
        this.play(false);
        this.show(track.time[plot.cursor.idx]);
      });
      this.drawn.push(plot);
    };
    if (track.margins.length) {
      this.plots.append(excite.make("h3", "", "Margins over time"));
      this.plots.append(grid);
      for (const margin of track.margins) {
        const unit = [...new Set(margin.places.map((place) => this.unitAt(margin.unit, place)))].join(" or ") || margin.unit;
        add(grid, {
          title: margin.title + (margin.required > 0 ? "" : ", to the nearest limit") + " [" + unit + "]",
          unit,
          height: 150,
          series: [{ label: "margin", role: "identified", values: margin.values }],
          lines: [{ label: "required", value: margin.required }],
          note: (i) => margin.places[margin.where[i]] || "",
        });
      }
    }
    if (!track.signals.length) return;
    const head = excite.make("h3", "", "Signals of ");
    const choice = excite.make("select");
    choice.setAttribute("aria-label", "joint");
    this.robot.joints.filter((joint) => !joint.free).forEach((joint, i) => {
      const option = excite.make("option", "", joint.name);
      option.value = i;
      choice.append(option);
    });
    head.append(choice);
    const signals = excite.make("div", "plots");
    this.plots.append(head, signals);
    const fixed = this.drawn.length;
    const showJoint = () => {
      for (const plot of this.drawn.splice(fixed)) {
        excite.plots.delete(plot);
        plot.destroy();
      }
      signals.replaceChildren();
      const joint = Number(choice.value);
      const unitOf = (signal) => this.unitAt(signal.unit, choice.selectedOptions[0].textContent);
      if (first.other) {
        add(signals, { title: first.otherLabel + " less " + first.label + " [" + unitOf(first) + "]", unit: unitOf(first), height: 150, series: [{ label: "difference", role: "nominal", values: apart[joint] }] });
      }
      for (const signal of track.signals) {
        const lines = (signal.limits ? signal.limits[joint] : []).filter((limit) => limit !== null);
        const series = [{ label: signal.label || "motion", role: "identified", values: signal.values[joint] }];
        if (signal.other) series.push({ label: signal.otherLabel, role: "nominal", dash: [5, 3], values: signal.other[joint] });
        add(signals, { title: signal.title + " [" + unitOf(signal) + "]", unit: unitOf(signal), height: 150, series, lines: lines.map((value) => ({ label: "limit", value })) });
      }
    };
    choice.addEventListener("change", showJoint);
    const [first] = track.signals;
    const apart = first.other ? first.values.map((column, i) => column.map((value, row) => first.other[i][row] - value)) : first.values;
    const widest = apart.map((column) => Math.max(...column) - Math.min(...column));
    choice.value = widest.indexOf(Math.max(...widest));
    showJoint();
  }
}
window.Replay = Replay;
