"use strict";

/* One flight in closed loop: the plant is the traced physics (`rates`, `loads`), the vehicle is flown by the
   flight code itself, as WebAssembly (wasm/flight.c). */
const Flight = (() => {
  const ALTITUDE = 0, LONGITUDE = 1, LATITUDE = 2, SPEED = 3, BANK = 6, STATES = 7;
  const RATE = 7, ANGLE = 8, TIME = 9, WORLD = 10, NUMBERS = 15, ENTRY = 6, TARGET = 4, FELT = 3;
  const LONGEST = 2; // final times of the reference

  /* The flight code with its tables opened; blobs lie behind its own memory, in whole pages. */
  async function open(code, tables, model) {
    const { instance } = await WebAssembly.instantiate(code, { env: Math });
    const own = instance.exports, page = 65536;
    let place = Math.ceil(own.room() / 8) * 8;
    const put = (bytes) => {
      const missing = place + bytes.length - own.memory.buffer.byteLength;
      if (missing > 0) own.memory.grow(Math.ceil(missing / page));
      new Uint8Array(own.memory.buffer).set(bytes, place);
      const at = place;
      place = Math.ceil((place + bytes.length) / 8) * 8;
      return at;
    };
    tables.forEach((blob, number) => {
      if (own.open_table(number, put(blob), blob.length) !== 0) throw new Error("the table cannot be opened");
    });
    if (model && own.open_model(put(model), model.length) !== 0) throw new Error("the model cannot be opened");
    const aim = put(new Uint8Array(8 * TARGET));
    return {
      own,
      told: new Float64Array(own.memory.buffer, own.in(), 64),
      found: new Float64Array(own.memory.buffer, own.out(), 4200),
      target: new Float64Array(own.memory.buffer, aim, TARGET),
    };
  }

  /* Inputs of the physics for parameters (SI): Eq. (1) of page_physics.py; entry state and target first. */
  function numbersOf(physics, parameters) {
    return physics.base.map((base, k) => physics.slope[k].reduce(
      (sum, slope, axis) => sum + slope * (parameters[axis] - physics.nominal[axis]), base));
  }

  /* A state of the plant and what has been flown so far. */
  class Plant {
    constructor(numbers, world, limits) {
      this.inputs = new Float64Array(NUMBERS + numbers.length - ENTRY - TARGET);
      this.inputs.set(world, WORLD);
      this.inputs.set(numbers.slice(ENTRY + TARGET), NUMBERS);
      this.state = Float64Array.from([...numbers.slice(0, ENTRY), 0]);
      this.sensed = new Float64Array(FELT + limits);
      this.peak = new Float64Array(limits);
      this.k = [0, 1, 2, 3].map(() => new Float64Array(STATES));
      this.there = new Float64Array(STATES);
    }

    /* The physics' inputs at `state`. */
    put(state, rate, angle, time) {
      this.inputs.set(state);
      this.inputs[RATE] = rate;
      this.inputs[ANGLE] = angle;
      this.inputs[TIME] = time;
      return this.inputs;
    }

    /* Specific force and uses of the limits here. */
    feel(rate, angle, time) {
      loads(this.put(this.state, rate, angle, time), this.sensed);
      for (let k = 0; k < this.peak.length; k++) {
        this.peak[k] = Math.max(this.peak[k], this.sensed[FELT + k]);
      }
    }

    /* The state plus `share` of a derivative. */
    moved(derivative, share) {
      for (let row = 0; row < STATES; row++) this.there[row] = this.state[row] + share * derivative[row];
      return this.there;
    }

    /* The state `h` later (RK4), steering linear from `old` to `fresh`. */
    ahead(old, fresh, time, h) {
      const [a, b, c, d] = this.k, next = new Float64Array(STATES);
      const rate = 0.5 * (old.rate + fresh.rate), angle = 0.5 * (old.angle + fresh.angle);
      rates(this.put(this.state, old.rate, old.angle, time), a);
      rates(this.put(this.moved(a, 0.5 * h), rate, angle, time + 0.5 * h), b);
      rates(this.put(this.moved(b, 0.5 * h), rate, angle, time + 0.5 * h), c);
      rates(this.put(this.moved(c, h), fresh.rate, fresh.angle, time + h), d);
      for (let row = 0; row < STATES; row++) {
        next[row] = this.state[row] + h / 6 * (a[row] + 2 * b[row] + 2 * c[row] + d[row]);
      }
      return next;
    }
  }

  const isOver = (state, speed) => !(state[SPEED] > speed) || !(state[ALTITUDE] > 0);

  /* Fly parameters (SI) in a world by table `number`, its plan corrected or not; cycles of `cycle` s. */
  function fly(code, physics, { parameters, world, number, corrected, cycle, finalTime }) {
    const numbers = numbersOf(physics, parameters), plant = new Plant(numbers, world, physics.limits);
    const target = numbers.slice(ENTRY, ENTRY + TARGET), track = [];
    code.told.set(parameters);
    code.target.set(target);
    code.own.begin(number, corrected ? 1 : 0, code.target.byteOffset);
    plant.state[BANK] = code.found[BANK];
    let steering = { rate: code.found[RATE], angle: 0 }, time = 0;
    for (let n = 0; time < LONGEST * finalTime && !isOver(plant.state, target[SPEED]); n++) {
      time = n * cycle;
      plant.feel(steering.rate, steering.angle, time);
      code.told.set(plant.state);
      code.told[STATES] = steering.rate;
      code.told.set(plant.sensed.subarray(0, FELT), STATES + 1);
      code.own.step(number, corrected ? 1 : 0, time);
      const fresh = { rate: code.found[0], angle: code.found[1] };
      track.push([time, ...plant.state]);
      const next = plant.ahead(steering, fresh, time, cycle);
      if (isOver(next, target[SPEED])) {
        time += end(plant, steering, fresh, time, cycle, target[SPEED]);
        track.push([time, ...plant.state]);
        break;
      }
      plant.state = next;
      steering = fresh;
      time += cycle;
    }
    const arrives = plant.state[ALTITUDE] > 0 && time < LONGEST * finalTime;
    return { state: plant.state, target, time, arrives, peak: plant.peak, track };
  }

  /* The state at the target's speed, or the ground, within a cycle, by bisection; how long until then. */
  function end(plant, old, fresh, time, cycle, speed) {
    let low = 0, high = cycle;
    for (let k = 0; k < 30; k++) {
      const h = 0.5 * (low + high), share = h / cycle;
      const there = { rate: old.rate + share * (fresh.rate - old.rate),
        angle: old.angle + share * (fresh.angle - old.angle) };
      if (isOver(plant.ahead(old, there, time, h), speed)) high = h; else low = h;
    }
    const share = low / cycle;
    plant.state = plant.ahead(old, { rate: old.rate + share * (fresh.rate - old.rate),
      angle: old.angle + share * (fresh.angle - old.angle) }, time, low);
    return low;
  }

  /* Great-circle miss (m), along and across an azimuth at the target. */
  function missOf(state, target, azimuth, radius) {
    const [, longitude, latitude] = target, east = state[LONGITUDE] - longitude, own = state[LATITUDE];
    const half = Math.sin(0.5 * (own - latitude)) ** 2
      + Math.cos(own) * Math.cos(latitude) * Math.sin(0.5 * east) ** 2;
    const miss = 2 * radius * Math.asin(Math.min(1, Math.sqrt(half)));
    const bearing = Math.atan2(Math.sin(east) * Math.cos(own),
      Math.cos(latitude) * Math.sin(own) - Math.sin(latitude) * Math.cos(own) * Math.cos(east));
    return { miss, along: miss * Math.cos(bearing - azimuth), across: miss * Math.sin(bearing - azimuth) };
  }

  return { open, numbersOf, fly, missOf, Plant, NUMBERS, FELT };
})();
