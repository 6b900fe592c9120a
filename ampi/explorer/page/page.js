"use strict";

/* The page: sliders move, references and flights follow at once, the corrected flight when they rest. */
(async () => {
  const REST = 250, DIFFERENCES = { altitude: ["altitude", "m", 1e3], speed: ["speed", "m/s", 1], bank: ["bank angle", "deg", 1] };
  const LOADS = ["ampi", "mpi", "quadratic", "nominal", "corrected"]; // colours of what has no mode
  const byId = (id) => document.getElementById(id);

  class Page {
    constructor(engine) {
      this.engine = engine;
      const moved = () => this.request();
      this.entry = new Controls.Group(byId("entry"), engine.parameters, byId("reset-entry"), moved);
      this.world = new Controls.Group(byId("world"), engine.world, byId("reset-world"), moved);
      this.rows();
      this.charts(byId("charts"));
      byId("foot").replaceChildren(...engine.left_out.map((text) => {
        const line = document.createElement("p");
        line.textContent = `Left out: ${text}.`;
        return line;
      }));
      new ResizeObserver(() => { this.track.moving = null; this.request(); }).observe(byId("charts"));
    }

    rows() {
      const corrected = { name: "corrected", label: "corrected in flight" };
      const plans = [...this.engine.modes, ...(this.engine.data.model ? [corrected] : [])];
      byId("flown").tBodies[0].replaceChildren(...plans.map(({ name, label }) => {
        const row = document.createElement("tr");
        row.id = `flown-${name}`;
        row.style.setProperty("--own", `var(--${name})`);
        row.innerHTML = `<th scope="row"></th>${["miss", "along", "across", "altitude", "time", "use"].map((cell) => `<td id="${cell}-${name}"></td>`).join("")}`;
        row.cells[0].textContent = label;
        return row;
      }));
    }

    charts(host) {
      const chart = (options) => new Chart.Lines(host, options);
      this.quantity = document.createElement("select");
      this.quantity.setAttribute("aria-label", "difference of");
      Object.entries(DIFFERENCES).forEach(([key, [label]]) => this.quantity.append(new Option(label, key)));
      this.quantity.onchange = () => this.request();
      this.altitudeOverSpeed = chart({ heading: "Altitude over speed", x: "speed (km/s)", y: "altitude (km)" });
      this.altitudeOverTime = chart({ heading: "Altitude over time", x: "time (s)", y: "altitude (km)" });
      this.bank = chart({ heading: "Bank angle", x: "time (s)", y: "bank angle (deg)" });
      this.loads = chart({ heading: "Loads of AMPI's reference, of their limits", x: "time (s)", y: "share of the limit" });
      this.differences = chart({ heading: "References less AMPI's", x: "time (s)", y: "", extra: this.quantity });
      this.ends = new Cloud.Ends(host, this.engine, (p, world) => {
        this.entry.values = p;
        this.world.values = world;
        this.request();
      });
      this.track = new Ground.Track(host, this.engine);
    }

    /* One update a frame, whatever moves. */
    request() {
      if (this.asked) return;
      this.asked = requestAnimationFrame(() => { this.asked = 0; this.update(); });
    }

    update() {
      const begun = performance.now(), p = this.entry.values, world = this.world.values;
      const found = this.engine.references(p);
      this.tellCell(found);
      this.drawReferences(found.modes);
      const drawn = performance.now();
      clearTimeout(this.resting);
      this.corrected = null;
      requestAnimationFrame(() => this.updateFlights(p, world, drawn - begun));
    }

    updateFlights(p, world, milliseconds) {
      const begun = performance.now();
      this.flown = this.engine.modes.map(({ name }) => ({ name, ...this.engine.fly(p, world, name) }));
      this.flown.forEach((flight) => this.tell(flight));
      this.drawFlights();
      this.tellAgreement(this.engine.compared(p));
      const flights = performance.now() - begun;
      byId("timing").textContent = `references ${milliseconds.toFixed(1)} ms, flights ${flights.toFixed(1)} ms`;
      Object.assign(document.body.dataset, { updateMs: milliseconds.toFixed(2), flightsMs: flights.toFixed(2), ready: "1", corrected: "" });
      if (this.engine.data.model) {
        byId("miss-corrected").textContent = "…";
        this.resting = setTimeout(() => this.correct(p, world), REST);
      }
    }

    correct(p, world) {
      this.corrected = { name: "corrected", ...this.engine.correct(p, world) };
      this.tell(this.corrected);
      this.drawFlights();
      document.body.dataset.corrected = "1";
    }

    tell({ name, miss, along, across, altitude, seconds, arrives, use }) {
      const put = (cell, text) => { byId(`${cell}-${name}`).textContent = text.replace("-", "−"); };
      const [limit, peak] = Object.entries(use).reduce((most, own) => (own[1] > most[1] ? own : most));
      put("miss", arrives ? miss.toFixed(2) : "does not arrive");
      put("along", arrives ? along.toFixed(2) : "");
      put("across", arrives ? across.toFixed(2) : "");
      put("altitude", arrives ? altitude.toFixed(0) : "");
      put("time", seconds.toFixed(0));
      put("use", `${limit.replace(/_/g, " ")} ${peak.toFixed(2)}`);
      byId(`use-${name}`).classList.toggle("over", peak > 1.001);
    }

    tellCell({ cell, clipped }) {
      const outside = cell.filter((own) => own.clipped).map(({ name }) => name.replace(/_/g, " "));
      this.entry.sliders.forEach((slider, k) => slider.own.classList.toggle("outside", cell[k].clipped));
      const text = clipped ? `Outside the hypercube in ${outside.join(", ")}: the reference is that of its boundary.` : "Inside the hypercube.";
      byId("cell").textContent = text;
    }

    tellAgreement({ ok, text, hole, largest }) {
      const badge = byId("agreement");
      badge.textContent = hole ? `${text}; a case beside this entry has no optimum` : text;
      badge.classList.toggle("bad", !ok || hole);
      badge.dataset.largest = largest;
    }

    drawReferences(modes) {
      const names = this.engine.modes.map(({ name }) => name), few = (list) => list.filter((_, k) => k % 2 === 0);
      const shown = names.map((name) => ({ colour: name, time: few(modes[name].time), own: modes[name] }));
      const lines = (x, y) => shown.map(({ colour, time, own }) => ({ colour, x: x ? x(own) : time, y: few(y(own)) }));
      this.altitudeOverSpeed.draw(lines((own) => few(own.speed).map((v) => v / 1e3), (own) => own.altitude));
      this.altitudeOverTime.draw(lines(null, (own) => own.altitude));
      this.bank.draw(lines(null, (own) => own.bank));
      const { ampi } = modes, loads = this.engine.limits.filter(({ name }) => name !== "bank_rate");
      this.loads.draw(loads.map(({ name, label }, k) => ({ colour: LOADS[k % 5], label, x: few(ampi.time), y: few(ampi.use[name]) })),
        { limits: [{ y: 1, label: "limit" }] });
      this.drawDifferences(modes, few(ampi.time));
      this.tracks = shown.map(({ colour, own }) => ({ colour, longitude: own.longitude, latitude: own.latitude }));
    }

    drawDifferences(modes, time) {
      const key = this.quantity.value, [, unit, factor] = DIFFERENCES[key];
      this.differences.y = `${DIFFERENCES[key][0]} difference (${unit})`;
      this.differences.draw(this.engine.modes.map(({ name }) => ({ colour: name, x: time,
        y: time.map((t) => factor * (this.engine.at(modes[name], t, key) - this.engine.at(modes.ampi, t, key))) })));
    }

    drawFlights() {
      const flown = [...this.flown, ...(this.corrected ? [this.corrected] : [])];
      this.ends.draw(flown.map(({ name, track }) => ({ colour: name, longitude: track.longitude.at(-1), latitude: track.latitude.at(-1) })));
      this.track.draw(flown.map(({ name, track }) => ({ colour: name, ...track })));
    }
  }

  try {
    window.page = new Page(await Explorer.open(DATA));
    window.page.request();
  } catch (error) {
    const badge = byId("agreement");
    badge.textContent = `This page needs a browser with WebAssembly and DecompressionStream: ${error.message}`;
    badge.classList.add("bad");
    throw error;
  }
})();
