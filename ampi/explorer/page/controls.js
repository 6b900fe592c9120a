"use strict";

/* Sliders: what they stand at, how far from nominal, and a way back. */
const Controls = (() => {
  class Slider {
    constructor(host, { name, label, unit, digits, low, high, nominal, step }, moved) {
      Object.assign(this, { nominal, digits, unit, points: null });
      const own = document.createElement("div");
      own.className = "slider";
      own.innerHTML = `<label for="p-${name}"></label><output for="p-${name}" id="value-${name}"></output>`
        + "<button type=\"button\">↺</button>";
      own.querySelector("label").textContent = label;
      this.button = own.querySelector("button");
      this.button.setAttribute("aria-label", `reset ${label}`);
      this.output = own.querySelector("output");
      this.input = document.createElement("input");
      const grain = step ?? (high - low) / 400;
      Object.assign(this.input, { type: "range", id: `p-${name}`, min: low, max: high, step: "any" });
      this.input.addEventListener("keydown", (event) => this.key(event, grain, moved));
      this.input.addEventListener("input", () => { this.tell(); moved(); });
      this.button.onclick = () => { this.value = nominal; moved(); this.input.focus(); };
      own.append(this.input);
      host.append(own);
      this.own = own;
      this.value = nominal;
    }

    get value() {
      return this.exact;
    }

    set value(value) {
      this.input.value = value;
      this.exact = value; // a range input keeps fewer digits
      this.tell(value);
    }

    /* Arrow keys move by a grain, with shift by ten. */
    key(event, grain, moved) {
      const sign = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
      if (!sign) return;
      event.preventDefault();
      const wanted = this.exact + sign * grain * (event.shiftKey ? 10 : 1);
      this.value = Math.min(Math.max(wanted, Number(this.input.min)), Number(this.input.max));
      moved();
    }

    tell(value = Number(this.input.value)) {
      this.exact = value;
      const away = value - this.nominal, small = document.createElement("small");
      const isMoved = Math.abs(away) > 0.5 * 10 ** -this.digits;
      const sign = away > 0 ? "+" : "−";
      small.textContent = isMoved ? ` (${sign}${Math.abs(away).toFixed(this.digits)})` : "";
      this.output.replaceChildren(`${value.toFixed(this.digits).replace("-", "−")} ${this.unit}`, small);
      this.own.classList.toggle("moved", isMoved);
    }
  }

  /* A group of sliders: its values, and back to nominal. */
  class Group {
    constructor(host, items, reset, moved) {
      this.sliders = items.map((item) => new Slider(host, item, moved));
      reset.onclick = () => { this.sliders.forEach((own) => { own.value = own.nominal; }); moved(); };
    }

    get values() {
      return this.sliders.map((own) => own.value);
    }

    set values(values) {
      this.sliders.forEach((own, k) => { own.value = values[k]; });
    }
  }

  return { Group };
})();
