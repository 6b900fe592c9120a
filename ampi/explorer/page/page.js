"use strict";

/* The page: sliders move, references and flights follow at once, the corrected flight when they rest. */
(async () => {
  const REST = 250, DIFFERENCES = { altitude: ["altitude", "m", 1e3], speed: ["speed", "m/s", 1], bank: ["bank angle", "deg", 1] };
  const LOADS = 5; // colours of what has no mode
  const byId = (id) => document.getElementById(id);
  const few = (list) => list.filter((_, k) => k % 2 === 0);

  class Page {
    constructor(engine) {
      this.engine = engine;
      const moved = () => this.request();
      this.entry = new Controls.Group(byId("entry"), engine.parameters, byId("reset-entry"), moved);
      this.world = new Controls.Group(byId("world"), engine.world, byId("reset-world"), moved);
      const corrected = engine.data.model ? [{ name: "corrected", label: "corrected in flight" }] : [];
      this.modes = engine.modes.map((own) => ({ ...own, dashed: own.name === "quadratic" })); // lies on AMPI
      this.results = new Results.Table([...this.modes, ...corrected]);
      Results.target(engine);
      Results.leftOut(engine.left_out);
      this.charts(byId("charts"));
      new ResizeObserver(() => { this.track.moving = null; this.redraw(); }).observe(byId("charts"));
    }

    charts(host) {
      const chart = (options) => new Chart.Lines(host, { x: "time (s)", ...options }), moved = () => this.redraw();
      const quantities = () => Controls.choice("difference in", Object.entries(DIFFERENCES).map(([key, [label]]) => [key, label]), moved);
      const [flown, planned] = [quantities(), quantities()];
      this.base = Controls.choice("difference from", this.modes.map(({ name, label }) => [name, label]), moved);
      this.base.value = "ampi";
      this.altitudeOverSpeed = chart({ heading: "Altitude over speed", x: "speed (km/s)", y: "altitude (km)", read: false });
      this.altitudeOverTime = chart({ heading: "Altitude over time", y: "altitude (km)" });
      this.bank = chart({ heading: "Bank angle", y: "bank angle (deg)" });
      this.loads = chart({ heading: "Loads of AMPI's reference", y: "share of the limit" });
      this.planned = { quantity: planned, chart: chart({ heading: "References less", y: "", extra: [this.base, "in", planned] }) };
      this.ends = new Cloud.Ends(host, this.engine, (p, world) => {
        this.entry.values = p;
        this.world.values = world;
        this.request();
      });
      this.departures = { quantity: flown, chart: chart({ heading: "Flights less their references in", y: "", extra: [flown] }) };
      this.track = new Ground.Track(host, this.engine);
    }

    /* One update a frame, whatever moves. */
    request() {
      if (this.asked) return;
      this.asked = requestAnimationFrame(() => { this.asked = 0; this.update(); });
    }

    /* All of it, though the entry be the same. */
    redraw() {
      this.told = null;
      this.request();
    }

    update() {
      const begun = performance.now(), p = this.entry.values, world = this.world.values;
      if (this.told !== p.join()) this.refer(p); // another world leaves references as they are
      const drawn = performance.now();
      clearTimeout(this.resting);
      this.corrected = null;
      requestAnimationFrame(() => this.updateFlights(p, world, drawn - begun));
    }

    refer(p) {
      this.told = p.join();
      const found = this.engine.references(p);
      Results.cells(found, this.entry.sliders, this.engine.parameters.map(({ label }) => label));
      this.references = found.modes;
      this.drawReferences(found.modes);
    }

    updateFlights(p, world, milliseconds) {
      const begun = performance.now();
      this.flown = this.modes.map((own) => ({ ...own, ...this.engine.fly(p, world, own.name) }));
      this.flown.forEach((flight) => this.results.tell(flight));
      this.drawFlights();
      Results.agreement(this.engine.compared(p));
      const flights = performance.now() - begun;
      byId("timing").textContent = `references ${milliseconds.toFixed(1)} ms, flights ${flights.toFixed(1)} ms`;
      Object.assign(document.body.dataset, { updateMs: milliseconds.toFixed(2), flightsMs: flights.toFixed(2), ready: "1", corrected: "" });
      if (this.engine.data.model) {
        this.results.wait("corrected");
        this.resting = setTimeout(() => this.correct(p, world), REST);
      }
    }

    correct(p, world) {
      this.corrected = { name: "corrected", ...this.engine.correct(p, world) };
      this.results.tell(this.corrected);
      this.drawFlights();
      document.body.dataset.corrected = "1";
    }

    drawReferences(modes) {
      const shown = this.modes.map(({ name, dashed }) => ({ colour: name, dashed, time: few(modes[name].time), own: modes[name] }));
      const lines = (row) => shown.map(({ colour, dashed, time, own }) => ({ colour, dashed, x: time, y: few(own[row]) }));
      const altitudes = lines("altitude");
      this.altitudeOverSpeed.draw(altitudes.map((line, k) => ({ ...line, x: few(shown[k].own.speed).map((v) => v / 1e3) })));
      this.altitudeOverTime.draw(altitudes);
      this.bank.draw(lines("bank"));
      const { ampi } = modes, loads = this.engine.limits.filter(({ name }) => name !== "bank_rate");
      this.loads.draw(loads.map(({ name, label }, k) => ({ colour: `load-${k % LOADS}`, x: few(ampi.time), y: few(ampi.use[name]),
        label: `${label} ${ampi.use[name].reduce((most, own) => Math.max(most, own), 0).toFixed(2)}` })),
      { limits: [{ y: 1, label: "limit" }] });
      const base = this.base.value, from = modes[base];
      this.drawDifferences(this.planned, shown.filter(({ colour }) => colour !== base).map((line) => ({ ...line, time: few(from.time), from })));
    }

    /* lines: [{colour, dashed, time, own, from}], own less from at the times. */
    drawDifferences({ quantity, chart }, lines) {
      const row = quantity.value, [label, unit, factor] = DIFFERENCES[row];
      chart.y = `${label} difference (${unit})`;
      chart.draw(lines.map(({ colour, dashed, time, own, from }) => ({ colour, dashed, x: time,
        y: time.map((t) => factor * (this.engine.at(own, t, row) - this.engine.at(from, t, row))) })), { zero: true });
    }

    drawFlights() {
      const flown = [...this.flown, ...(this.corrected ? [this.corrected] : [])];
      const tracks = flown.map(({ name, dashed, track }) => ({ colour: name, dashed, ...track }));
      this.drawDifferences(this.departures, flown.map(({ name, dashed, track }) => (
        { colour: name, dashed, time: few(track.time), own: track, from: this.references[name] ?? this.references.ampi })));
      this.ends.draw(tracks.map(({ colour, longitude, latitude }) => ({ colour, longitude: longitude.at(-1), latitude: latitude.at(-1) })));
      this.track.draw(tracks);
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
