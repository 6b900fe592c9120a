"use strict";

/* Around the target: rings, the ends of what is flown now, and the flights of campaigns with their ellipses. A
   flight is chosen by a click or by the arrow keys, and shows itself. */
const Cloud = (() => {
  const { element, figure, ticks, written } = Chart, MARGIN = { left: 46, right: 12, top: 24, bottom: 40 };
  const ROOM = 1.15, LEAST = 0.05, SIDE = 480; // km of the narrowest view; pixels
  const SCALES = [["all", "all ends"], ["flights", "the flights"], ["rings", "the rings"]];
  const percent = (share) => (100 * share).toFixed(1);

  class Ends {
    constructor(host, engine, show) {
      this.engine = engine;
      this.show = show;
      this.chosen = -1;
      this.place = Ground.local(engine.target, engine.data.radius);
      const campaigns = engine.flights?.campaigns ?? [];
      this.select = Controls.choice("campaign", campaigns.map(({ label }, k) => [k, label]), () => this.choose(-1));
      this.select.hidden = campaigns.length === 0;
      this.scale = Controls.choice("scale", SCALES.filter(([name]) => campaigns.length || name !== "flights"), () => this.draw(this.ends));
      Object.assign(this, figure(host, "Ends", "", [this.select, this.scale]));
      this.own.classList.add("tall");
      this.caption = document.createElement("figcaption");
      this.caption.setAttribute("aria-live", "polite");
      this.own.append(this.caption);
      if (campaigns.length) this.listen();
    }

    listen() {
      this.svg.setAttribute("tabindex", "0");
      this.svg.setAttribute("role", "application");
      this.svg.setAttribute("aria-label", "Flights of the campaign: arrow keys choose one, End the farthest, Escape none");
      this.svg.addEventListener("keydown", (event) => this.key(event));
      this.svg.addEventListener("click", (event) => this.click(event));
    }

    get campaign() {
      return this.engine.flights?.campaigns[Number(this.select.value)] ?? null;
    }

    /* Half width in km of what the scale asks for. */
    reach(ends) {
      const { radii } = this.engine.target, own = this.campaign, wanted = this.scale.value;
      if (wanted === "rings") return ROOM * radii.at(-1);
      const cloud = (own?.ellipses ?? []).flatMap((one) => one.outline.map(([x, y]) => Math.hypot(...this.place(x, y))));
      const flown = wanted === "all" ? ends.map(({ at }) => Math.hypot(...at)) : [];
      return ROOM * Math.max(LEAST, ...cloud, ...flown.filter((away) => away < 8 * radii.at(-1)));
    }

    /* ends: [{longitude, latitude, colour}] of what is flown now. */
    draw(ends) {
      this.ends = ends;
      const flown = ends.map((own) => ({ ...own, at: this.place(own.longitude, own.latitude) }));
      const side = Math.min((this.own.clientWidth || SIDE) - MARGIN.left - MARGIN.right, SIDE - MARGIN.left), half = this.reach(flown);
      const scale = 0.5 * side / half, left = MARGIN.left + 0.5 * side, top = MARGIN.top + 0.5 * side;
      this.toPixels = ([x, y]) => [left + scale * x, top - scale * y];
      const plot = document.createDocumentFragment();
      this.frame(plot, half, side);
      const clip = element(plot, "clipPath", { id: "ends" });
      element(clip, "rect", { x: MARGIN.left, y: MARGIN.top, width: side, height: side });
      const inside = element(plot, "g", { "clip-path": "url(#ends)" });
      for (const radius of this.engine.target.radii) this.ring(inside, radius, radius * scale);
      this.flights(inside);
      for (const { at, colour } of flown) {
        const [x, y] = this.toPixels(at);
        element(inside, "path", { class: "end", style: `--own: var(--${colour})`, d: `M${x - 6} ${y - 6}l12 12M${x + 6} ${y - 6}l-12 12` });
      }
      element(inside, "path", { class: "target", d: `M${left - 6} ${top}h12M${left} ${top - 6}v12` });
      const width = side + MARGIN.left + MARGIN.right;
      this.svg.setAttribute("viewBox", `0 0 ${width} ${side + MARGIN.top + MARGIN.bottom}`);
      this.svg.style.maxWidth = `${width}px`;
      this.svg.replaceChildren(plot);
      this.tell(flown.filter(({ at }) => Math.max(...at.map(Math.abs)) > half).length);
    }

    ring(plot, radius, size) {
      const [x, y] = this.toPixels([0, 0]);
      element(plot, "circle", { class: "ring", cx: x, cy: y, r: size });
      if (size > 24) element(plot, "text", { class: "halo", x, y: y - size + 4, "text-anchor": "middle" }, `${radius} km`);
    }

    frame(plot, half, side) {
      const { step, values } = ticks(-half, half, 6), low = MARGIN.left, high = low + side, top = MARGIN.top, bottom = top + side;
      for (const value of values) {
        const [x, y] = this.toPixels([value, value]);
        element(plot, "path", { class: "grid", d: `M${x} ${top}V${bottom}M${low} ${y}H${high}` });
        element(plot, "text", { x, y: bottom + 16, "text-anchor": "middle" }, written(value, step));
        element(plot, "text", { x: low - 6, y: y + 4, "text-anchor": "end" }, written(value, step));
      }
      element(plot, "rect", { class: "axis", x: low, y: top, width: side, height: side });
      element(plot, "text", { class: "label", x: 0.5 * (low + high), y: bottom + 34, "text-anchor": "middle" }, "east of the target (km)");
      element(plot, "text", { class: "label", x: low, y: top - 9 }, "north (km)");
    }

    flights(plot) {
      const own = this.campaign;
      if (!own) return;
      const colour = own.correction === "none" ? own.mode : "corrected", style = `--own: var(--${colour})`;
      own.longitude.forEach((longitude, k) => {
        if (longitude === null) return;
        const [cx, cy] = this.toPixels(this.place(longitude, own.latitude[k]));
        element(plot, "circle", { class: "flight", style, cx, cy, r: 3, "data-flight": k });
        if (k === this.chosen) element(plot, "circle", { class: "chosen", cx, cy, r: 7 });
      });
      for (const { outline, kind } of own.ellipses) {
        const points = outline.map(([x, y]) => this.toPixels(this.place(x, y)).map((v) => v.toFixed(1)).join(" "));
        element(plot, "path", { class: kind === "contains" ? "line dashed" : "line", style, d: `M${points.join("L")}Z` });
      }
    }

    /* Under the figure: shares, what the marks are, what is chosen. */
    tell(beyond) {
      const own = this.campaign, outside = beyond ? ` ${beyond} of them beyond the frame.` : "";
      const sentences = [`Crosses: what is flown now.${outside}`];
      if (own) {
        const shares = own.within.map(({ radius, share, low, high }) => `${percent(share)} % [${percent(low)}, ${percent(high)}] within ${radius} km`);
        sentences.push(`Dots: ${own.n} flights, ${shares.join("; ")}. Ellipses: 95 % of a normal, solid; 95 % of all, dashed.`);
        sentences.push(this.chosen < 0 ? "A click or the arrow keys choose a flight: sliders take its entry and its world."
          : `Flight ${this.chosen}: ${own.arrives[this.chosen] ? `missed by ${own.miss[this.chosen]} km` : "fell short"} in the campaign.`);
      }
      const text = sentences.join(" ");
      if (this.caption.textContent !== text) this.caption.textContent = text; // it is read aloud
    }

    key(event) {
      const { miss } = this.campaign, count = miss.length, from = this.chosen;
      const keys = { ArrowRight: from + 1, ArrowDown: from + 1, ArrowLeft: from < 0 ? -1 : from - 1, ArrowUp: from < 0 ? -1 : from - 1,
        Home: 0, End: miss.indexOf(Math.max(...miss.filter((own) => own !== null))) };
      if (event.key !== "Escape" && !(event.key in keys)) return;
      event.preventDefault();
      this.choose(event.key === "Escape" ? -1 : (keys[event.key] + count) % count);
    }

    click(event) {
      const box = this.svg.getBoundingClientRect(), side = this.svg.viewBox.baseVal.width / box.width;
      const [x, y] = [(event.clientX - box.left) * side, (event.clientY - box.top) * side];
      let best = -1, nearest = 20;
      this.svg.querySelectorAll(".flight").forEach((own) => {
        const away = Math.hypot(own.cx.baseVal.value - x, own.cy.baseVal.value - y);
        if (away < nearest) [best, nearest] = [Number(own.dataset.flight), away];
      });
      if (best >= 0) this.choose(best);
    }

    choose(flight) {
      this.chosen = flight;
      if (flight < 0) this.draw(this.ends);
      else this.show(this.campaign.parameters[flight], this.campaign.world[flight]);
    }
  }

  return { Ends };
})();
