"use strict";

/* Sliders: what they stand at, how far from nominal, the table's points under them, and a way back. */
const Controls = (() => {
  const BODY = "<label></label><output aria-live=\"off\"></output><button type=\"button\" class=\"back\">↺</button>"
    + "<div class=\"marks\" aria-hidden=\"true\"><i class=\"cell\"></i></div>";

  class Slider {
    constructor(host, { name, label, unit, digits, low, high, nominal, step, points }, moved) {
      Object.assign(this, { nominal, digits, unit, low, high });
      const own = document.createElement("div");
      own.className = "slider";
      own.innerHTML = BODY;
      Object.assign(own.querySelector("label"), { textContent: label, htmlFor: `p-${name}` });
      this.output = Object.assign(own.querySelector("output"), { id: `value-${name}` });
      this.output.htmlFor.value = `p-${name}`;
      this.button = own.querySelector("button");
      this.button.setAttribute("aria-label", `reset ${label}`);
      this.input = document.createElement("input");
      const grain = step ?? (high - low) / 400;
      Object.assign(this.input, { type: "range", id: `p-${name}`, min: low, max: high, step: "any" });
      this.input.addEventListener("keydown", (event) => this.key(event, grain, moved));
      this.input.addEventListener("input", () => { this.tell(); moved(); });
      this.button.onclick = () => { this.value = nominal; moved(); this.input.focus(); };
      own.querySelector(".marks").before(this.input);
      this.mark(own.querySelector(".marks"), points ?? [nominal]);
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

    share(value) {
      return `${(100 * (value - this.low) / (this.high - this.low)).toFixed(2)}%`;
    }

    mark(strip, points) {
      this.band = strip.firstChild;
      strip.append(...points.map((point) => {
        const own = document.createElement("i");
        own.style.left = this.share(point);
        return own;
      }));
    }

    /* The cell that the entry lies in, or is clipped to. */
    set cell({ low, high, clipped }) {
      Object.assign(this.own.dataset, { low, high, clipped });
      this.own.classList.toggle("outside", clipped);
      Object.assign(this.band.style, { left: this.share(low), right: `calc(100% - ${this.share(high)})` });
    }

    /* Arrow keys move by a grain, with shift by ten. */
    key(event, grain, moved) {
      const sign = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
      if (!sign) return;
      event.preventDefault();
      const wanted = this.exact + sign * grain * (event.shiftKey ? 10 : 1);
      this.value = Math.min(Math.max(wanted, this.low), this.high);
      moved();
    }

    tell(value = Number(this.input.value)) {
      this.exact = value;
      const away = value - this.nominal, small = document.createElement("small");
      const isMoved = Math.abs(away) > 0.5 * 10 ** -this.digits;
      const sign = away > 0 ? "+" : "−";
      small.textContent = isMoved ? ` (${sign}${Math.abs(away).toFixed(this.digits)})` : "";
      const told = `${value.toFixed(this.digits).replace("-", "−")} ${this.unit}`;
      this.output.replaceChildren(told, small);
      this.input.setAttribute("aria-valuetext", told);
      this.own.classList.toggle("moved", isMoved);
      this.button.disabled = !isMoved; // out of the tab order
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

  /* A choice among [value, label] pairs. */
  function choice(name, pairs, changed) {
    const own = document.createElement("select");
    own.setAttribute("aria-label", name);
    own.append(...pairs.map(([value, label]) => new Option(label, value)));
    own.onchange = changed;
    return own;
  }

  return { Group, choice };
})();
