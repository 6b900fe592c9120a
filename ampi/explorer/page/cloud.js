"use strict";

/* Around the target: rings, the ends of what is flown now, and the flights of campaigns with their ellipses. A
   flight is chosen by a click or by the arrow keys, and shows itself. */
const Cloud = (() => {
  const { element, figure, ticks, written } = Chart, ROOM = 1.15, MARGIN = 40;
  const COLOURS = { nominal: "nominal", mpi: "mpi", ampi: "ampi", quadratic: "quadratic" };

  class Ends {
    constructor(host, engine, show) {
      this.engine = engine;
      this.show = show;
      this.place = Ground.local(engine.target, engine.data.radius);
      const campaigns = engine.flights?.campaigns ?? [];
      this.select = document.createElement("select");
      this.select.setAttribute("aria-label", "campaign");
      campaigns.forEach((own, k) => this.select.append(new Option(own.label, k)));
      this.select.hidden = campaigns.length === 0;
      this.select.onchange = () => { this.chosen = -1; this.draw(this.ends); };
      const told = campaigns.length ? "A click or the arrow keys choose a flight: sliders take its entry and its world." : "";
      Object.assign(this, figure(host, "Ends around the target", told, this.select));
      this.caption = document.createElement("figcaption");
      this.caption.setAttribute("aria-live", "polite");
      this.own.append(this.caption);
      this.chosen = -1;
      this.svg.setAttribute("tabindex", campaigns.length ? "0" : "-1");
      this.svg.addEventListener("keydown", (event) => this.key(event));
      this.svg.addEventListener("click", (event) => this.click(event));
    }

    get campaign() {
      return this.engine.flights?.campaigns[Number(this.select.value)] ?? null;
    }

    /* Half width in km: the flights' ellipses, or the second ring, and what is flown now. */
    reach(ends) {
      const own = this.campaign, radii = this.engine.target.radii;
      const far = ends.map(({ at }) => Math.hypot(...at));
      const edges = own ? own.ellipses.filter((one) => one.kind === "contains")
        .flatMap((one) => one.outline.map(([x, y]) => Math.hypot(...this.place(x, y)))) : [];
      return ROOM * Math.max(radii[0], ...edges, ...far.filter((d) => d < 4 * radii.at(-1)));
    }

    /* ends: [{longitude, latitude, colour}] of what is flown now. */
    draw(ends) {
      this.ends = ends;
      const flown = ends.map((own) => ({ ...own, at: this.place(own.longitude, own.latitude) }));
      const side = Math.min(this.own.clientWidth || 480, 520), half = this.reach(flown);
      const scale = (0.5 * side - MARGIN) / half, middle = 0.5 * side;
      this.toPixels = ([x, y]) => [middle + scale * x, middle - scale * y];
      const plot = document.createDocumentFragment();
      this.frame(plot, half, side);
      const clip = element(element(plot, "clipPath", { id: "ends" }), "rect",
        { x: MARGIN, y: MARGIN, width: side - 2 * MARGIN, height: side - 2 * MARGIN });
      const inside = element(plot, "g", { "clip-path": `url(#${clip.parentNode.id})` });
      for (const radius of this.engine.target.radii) {
        element(inside, "circle", { class: "ring", cx: middle, cy: middle, r: radius * scale });
      }
      this.flights(inside);
      for (const { at, colour } of flown) {
        const [x, y] = this.toPixels(at);
        element(inside, "path", { class: "end", style: `--own: var(--${colour})`, d: `M${x - 6} ${y - 6}l12 12M${x + 6} ${y - 6}l-12 12` });
      }
      element(inside, "path", { class: "target", d: `M${middle - 6} ${middle}h12M${middle} ${middle - 6}v12` });
      this.svg.setAttribute("viewBox", `0 0 ${side} ${side}`);
      this.svg.style.maxWidth = `${side}px`;
      this.svg.replaceChildren(plot);
    }

    frame(plot, half, side) {
      const { step, values } = ticks(-half, half, 6), low = MARGIN, high = side - MARGIN;
      for (const value of values) {
        const [x, y] = this.toPixels([value, value]);
        element(plot, "path", { class: "grid", d: `M${x} ${low}V${high}M${low} ${y}H${high}` });
        element(plot, "text", { x, y: high + 16, "text-anchor": "middle" }, written(value, step));
        element(plot, "text", { x: low - 5, y: y + 4, "text-anchor": "end" }, written(value, step));
      }
      element(plot, "rect", { class: "axis", x: low, y: low, width: high - low, height: high - low });
      element(plot, "text", { class: "label", x: high, y: high + 32, "text-anchor": "end" }, "east of the target (km)");
      element(plot, "text", { class: "label", x: low, y: low - 10 }, "north (km)");
    }

    flights(plot) {
      const own = this.campaign;
      if (!own) return;
      const colour = own.correction === "none" ? COLOURS[own.mode] ?? "ampi" : "corrected", style = `--own: var(--${colour})`;
      own.longitude.forEach((longitude, k) => {
        if (longitude === null) return;
        const [cx, cy] = this.toPixels(this.place(longitude, own.latitude[k]));
        element(plot, "circle", { class: "flight", style, cx, cy, r: 3, "data-flight": k });
        if (k === this.chosen) element(plot, "circle", { class: "chosen", cx, cy, r: 7 });
      });
      for (const { outline, kind } of own.ellipses) {
        const points = outline.map(([x, y]) => this.toPixels(this.place(x, y)).map((v) => v.toFixed(1)).join(" "));
        element(plot, "path", { class: kind === "contains" ? "line thin" : "line", style, d: `M${points.join("L")}Z` });
      }
      const shares = own.within.map(({ radius, share, low, high }) => `${(100 * share).toFixed(1)} % [${(100 * low).toFixed(1)}, ${(100 * high).toFixed(1)}] within ${radius} km`);
      const chosen = this.chosen < 0 ? "" : ` Flight ${this.chosen} missed by ${own.miss[this.chosen]} km in the campaign.`;
      this.caption.textContent = `${own.n} flights: ${shares.join("; ")}. Solid: 95 % of a normal; dashed: holds 95 % of all.${chosen}`;
    }

    key(event) {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step || !this.campaign) return;
      event.preventDefault();
      const count = this.campaign.longitude.length;
      this.choose((this.chosen + step + count) % count);
    }

    click(event) {
      if (!this.campaign) return;
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
      this.show(this.campaign.parameters[flight], this.campaign.world[flight]);
    }
  }

  return { Ends };
})();
