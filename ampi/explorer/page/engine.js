"use strict";

/* What the page computes, in the units that it shows: references, flights, corrected flights. */
const Explorer = (() => {
  const ROWS = ["altitude", "longitude", "latitude", "speed", "path", "azimuth", "bank", "rate"];
  const DEGREE = 180 / Math.PI, SHOWN = [1e-3, DEGREE, DEGREE, 1, DEGREE, DEGREE, DEGREE, DEGREE];
  const CYCLE = 1; // s, of the flights

  const DEVIATIONS = [
    { name: "density", label: "air density", unit: "×", low: 0.8, high: 1.2, nominal: 1, step: 0.005, digits: 3 },
    { name: "lift", label: "lift coefficient", unit: "×", low: 0.85, high: 1.15, nominal: 1, step: 0.005, digits: 3 },
    { name: "drag", label: "drag coefficient", unit: "×", low: 0.85, high: 1.15, nominal: 1, step: 0.005, digits: 3 },
    { name: "wind_east", label: "wind to the east", unit: "m/s", low: -80, high: 80, nominal: 0, step: 1, digits: 0 },
    { name: "wind_north", label: "wind to the north", unit: "m/s", low: -80, high: 80, nominal: 0, step: 1, digits: 0 },
  ];

  async function open(data) {
    const values = await Table.unpacked(data.table);
    const shared = await Table.inflated(data.shared), columns = data.table.shape.at(-1);
    const heads = await Promise.all(data.modes.map((mode) => Table.inflated(mode.head)));
    const blobs = data.modes.map((mode, k) => Table.blobOf(
      { head: heads[k], vertices: mode.vertices ?? Array.from({ length: values.length / columns }, (_, v) => v) },
      shared, values, columns, Table.bytesOf(mode.holes)));
    const model = data.model ? await Table.inflated(data.model) : null;
    const code = await Flight.open(await Table.inflated(data.code), blobs, model);
    return new Engine(data, blobs.map(Table.read), code);
  }

  class Engine {
    constructor(data, tables, code) {
      Object.assign(this, data.shown);
      this.data = data;
      this.tables = tables;
      this.code = code;
      this.world = DEVIATIONS;
      this.physics = { ...data.physics, nominal: data.nominal, limits: data.limits.length };
      this.ranges = data.ranges;
      this.nominalAzimuth = this.references(this.parameters.map((own) => own.nominal)).modes.nominal.azimuth.at(-1);
    }

    inSi(p) {
      return p.map((value, k) => value * this.data.units[k]);
    }

    /* References of all modes. */
    references(p) {
      const told = this.inSi(p), modes = {}, numbers = Flight.numbersOf(this.physics, told);
      let places = [];
      this.nodal = this.tables.map((table, number) => {
        const { name } = this.modes[number], found = Table.nodal(table, told);
        if (name === "ampi") places = found.places;
        modes[name] = this.reference(table, found, numbers);
        return found.values;
      });
      const cell = places.map((place, k) => this.cellOf(place, k));
      return { cell, clipped: cell.some((own) => own.clipped), modes };
    }

    /* The last references beside the flight code's; whether a case without optimum has weight. */
    compared(p) {
      const told = this.inSi(p);
      let largest = 0, hole = false; // of AMPI's reference: quadratic ones reach farther
      this.modes.forEach(({ name }, number) => {
        largest = Math.max(largest, this.disagreement(number, told, this.nodal[number]));
        if (name === "ampi") hole = this.code.own.is_hole() !== 0;
      });
      const range = largest > 0 ? `to ${largest.toExponential(0)} of each row's range` : "to the bit";
      return { largest, ok: largest < 1e-12, hole,
        text: `the flight code in C, here as WebAssembly, and this page agree ${range}` };
    }

    cellOf({ cell, clipped }, k) {
      const { name, points } = this.parameters[k];
      return { name, low: points[cell], high: points[Math.min(cell + 1, points.length - 1)], clipped };
    }

    /* Largest difference of nodal values from the flight code's, in shares of each row's range. */
    disagreement(number, told, values) {
      this.code.told.set(told);
      const count = this.code.own.reference(number), rows = this.ranges.length - 1;
      let largest = 0;
      for (let k = 0; k < count; k++) {
        const row = k === count - 1 ? rows : k % rows;
        largest = Math.max(largest, Math.abs(values[k] - this.code.found[k]) / this.ranges[row]);
      }
      return largest;
    }

    reference(table, { values, finalTime }, numbers) {
      const rows = ROWS.map((_, row) => Table.highDensity(table, values, row));
      const found = { time: Table.times(table, finalTime), finalTime };
      ROWS.forEach((name, row) => { found[name] = rows[row].map((value) => value * SHOWN[row]); });
      let use = null; // most pages show the loads of one reference
      Object.defineProperty(found, "use", { get: () => (use ??= this.usesAlong(rows, finalTime, table, numbers)) });
      return found;
    }

    usesAlong(rows, finalTime, table, numbers) {
      const plant = new Flight.Plant(numbers, [1, 1, 1, 0, 0], this.data.limits.length), use = {};
      const times = Table.times(table, finalTime), size = table.points;
      this.data.limits.forEach((name) => { use[name] = new Float64Array(size); });
      for (let k = 0; k < size; k++) {
        for (let row = 0; row < 7; row++) plant.state[row] = rows[row][k];
        plant.feel(rows[7][k], 0, times[k]);
        this.data.limits.forEach((name, limit) => { use[name][k] = plant.sensed[Flight.FELT + limit]; });
      }
      return use;
    }

    /* A row of a reference at a time, linear between its points. */
    at(reference, time, row) {
      const times = reference.time, last = times.length - 1;
      if (time <= times[0]) return reference[row][0];
      if (time >= times[last]) return reference[row][last];
      let low = 0, high = last;
      while (high - low > 1) {
        const middle = low + high >> 1;
        if (times[middle] <= time) low = middle; else high = middle;
      }
      const share = (time - times[low]) / (times[high] - times[low]);
      return reference[row][low] + share * (reference[row][high] - reference[row][low]);
    }

    fly(p, world, mode) {
      return this.flown(p, world, mode, false);
    }

    correct(p, world) {
      return this.data.model ? this.flown(p, world, "ampi", true) : null;
    }

    flown(p, world, mode, corrected) {
      const parameters = this.inSi(p), number = this.modes.findIndex((own) => own.name === mode);
      const { finalTime } = Table.nodal(this.tables[number], parameters);
      const found = Flight.fly(this.code, this.physics,
        { parameters, world, number, corrected, cycle: CYCLE, finalTime });
      const { miss, along, across } = Flight.missOf(
        found.state, found.target, this.nominalAzimuth / DEGREE, this.data.radius);
      const track = { time: found.track.map((row) => row[0]) };
      ROWS.slice(0, 7).forEach((name, row) => {
        track[name] = found.track.map((point) => point[row + 1] * SHOWN[row]);
      });
      const use = {};
      this.data.limits.forEach((name, k) => { use[name] = found.peak[k]; });
      return { miss: miss / 1e3, along: along / 1e3, across: across / 1e3,
        altitude: found.state[0] - found.target[0], speed: found.state[3] - found.target[3],
        seconds: found.time, arrives: found.arrives, use, track };
    }
  }

  return { open };
})();
