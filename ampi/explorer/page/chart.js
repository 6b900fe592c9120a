"use strict";

/* Line charts in SVG: nice ticks, a frame, lines by the colour of what they show, values under the pointer. */
const Chart = (() => {
  const NS = "http://www.w3.org/2000/svg", HEIGHT = 250;
  const MARGIN = { left: 66, right: 14, top: 10, bottom: 40 };

  function element(parent, name, attributes = {}, text = "") {
    const own = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) own.setAttribute(key, value);
    if (text) own.textContent = text;
    parent?.appendChild(own);
    return own;
  }

  /* Round numbers from low to high, some five of them. */
  function ticks(low, high, most = 6) {
    const raw = (high - low) / most || 1, size = 10 ** Math.floor(Math.log10(raw));
    const step = size * [1, 2, 5, 10].find((k) => k * size >= raw * 0.999);
    const first = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - first + 1;
    return { step, values: Array.from({ length: Math.max(count, 0) }, (_, k) => (first + k) * step) };
  }

  function written(value, step) {
    const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
    return value.toFixed(digits).replace(/^-0(\.0*)?$/, "0").replace("-", "−");
  }

  /* Least and greatest of many lists, with a little room. */
  function extent(lists, room = 0.04) {
    let low = Infinity, high = -Infinity;
    for (const list of lists) {
      for (let k = 0; k < list.length; k++) {
        if (list[k] < low) low = list[k];
        if (list[k] > high) high = list[k];
      }
    }
    if (!(high > low)) [low, high] = [(low || 0) - 1, (high || 0) + 1];
    return [low - room * (high - low), high + room * (high - low)];
  }

  /* What a colour means. */
  function key(colour, dashed, ...content) {
    const own = document.createElement("span");
    own.className = dashed ? "key dashed" : "key";
    own.style.setProperty("--own", `var(--${colour})`);
    own.append(...content);
    return own;
  }

  /* A figure with a heading; `extra` stands behind it. */
  function figure(host, heading, caption, extra = []) {
    const own = document.createElement("figure"), title = document.createElement("h3");
    title.append(heading, ...extra);
    own.append(title);
    const svg = element(own, "svg", { role: "img", "aria-label": heading });
    if (caption) {
      const text = document.createElement("figcaption");
      text.textContent = caption;
      own.append(text);
    }
    host.append(own);
    return { own, svg };
  }

  /* What a line chart is at last: series [{x, y, colour, label, dashed}] of rising x, and how they lie on paper. */
  class Lines {
    constructor(host, { heading, x, y, caption = "", extra = [], read = true }) {
      Object.assign(this, { x, y }, figure(host, heading, caption, extra));
      if (!read) return;
      this.svg.addEventListener("pointermove", (event) => this.read(event));
      this.svg.addEventListener("pointerleave", () => this.pointer?.replaceChildren());
    }

    draw(series, { limits = [], zero = false } = {}) {
      const width = this.own.clientWidth || 480, plot = document.createDocumentFragment();
      const [x0, x1] = extent(series.map((own) => own.x), 0);
      const bounds = limits.map((own) => [own.y]);
      const [y0, y1] = extent([...series.map((own) => own.y), ...bounds]);
      const right = width - MARGIN.right, bottom = HEIGHT - MARGIN.bottom;
      const px = (value) => MARGIN.left + (value - x0) / (x1 - x0) * (right - MARGIN.left);
      const py = (value) => bottom - (value - y0) / (y1 - y0) * (bottom - MARGIN.top);
      this.frame(plot, { x0, x1, y0, y1, px, py, right, bottom });
      if (zero) element(plot, "path", { class: "zero", d: `M${MARGIN.left} ${py(0)}H${right}` });
      for (const { y, label } of limits) {
        element(plot, "path", { class: "limit", d: `M${MARGIN.left} ${py(y)}H${right}` });
        element(plot, "text", { x: right - 4, y: py(y) + 14, "text-anchor": "end" }, label);
      }
      for (const own of series) {
        element(plot, "path", { class: own.dashed ? "line dashed" : "line", style: `--own: var(--${own.colour})`,
          d: path(own.x, own.y, px, py) });
      }
      this.pointer = element(plot, "g");
      this.drawn = { series, px, py, x0, x1, width, right, bottom };
      this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
      this.svg.replaceChildren(plot);
      this.tell(series.filter(({ label }) => label));
    }

    /* Keys under the chart, where its colours are its own. */
    tell(series) {
      if (!series.length) return;
      if (!this.legend) this.own.append(this.legend = document.createElement("figcaption"));
      this.legend.replaceChildren(...series.map(({ colour, dashed, label }) => key(colour, dashed, label)));
    }

    frame(plot, { x0, x1, y0, y1, px, py, right, bottom }) {
      const across = ticks(x0, x1), up = ticks(y0, y1, 5);
      for (const value of across.values) {
        element(plot, "path", { class: "grid", d: `M${px(value)} ${MARGIN.top}V${bottom}` });
        element(plot, "text", { x: px(value), y: bottom + 16, "text-anchor": "middle" }, written(value, across.step));
      }
      for (const value of up.values) {
        element(plot, "path", { class: "grid", d: `M${MARGIN.left} ${py(value)}H${right}` });
        element(plot, "text", { x: MARGIN.left - 7, y: py(value) + 4, "text-anchor": "end" }, written(value, up.step));
      }
      this.step = up.step;
      element(plot, "path", { class: "axis", d: `M${MARGIN.left} ${MARGIN.top}V${bottom}H${right}` });
      const middle = 0.5 * (MARGIN.top + bottom);
      element(plot, "text", { class: "label", x: 0.5 * (MARGIN.left + right), y: bottom + 34, "text-anchor": "middle" }, this.x);
      element(plot, "text", { class: "label", "text-anchor": "middle", transform: `rotate(-90) translate(${-middle} 13)` }, this.y);
    }

    /* The values of all series where the pointer is. */
    read(event) {
      if (!this.drawn) return;
      const { series, px, py, x0, x1, width, right, bottom } = this.drawn, box = this.svg.getBoundingClientRect();
      const share = ((event.clientX - box.left) * width / box.width - MARGIN.left) / (right - MARGIN.left);
      const plot = document.createDocumentFragment(), x = x0 + share * (x1 - x0), end = share > 0.6;
      if (share < 0 || share > 1) return void this.pointer.replaceChildren();
      element(plot, "path", { class: "pointer", d: `M${px(x)} ${MARGIN.top}V${bottom}` });
      const told = series.flatMap((own) => {
        const k = own.x.findIndex((value) => value >= x);
        return k < 0 ? [] : [{ ...own, value: own.y[k] }];
      });
      const put = (line, text, colour = "ink") => element(plot, "text", { class: "read", x: px(x) + (end ? -6 : 6),
        y: MARGIN.top + 12 + 14 * line, "text-anchor": end ? "end" : "start", style: `fill: var(--${colour})` }, text);
      put(0, written(x, 1));
      told.forEach(({ value, colour }, k) => {
        element(plot, "circle", { class: "dot", cx: px(x), cy: py(value), r: 3, style: `--own: var(--${colour})` });
        put(k + 1, written(value, this.step / 100), colour);
      });
      this.pointer.replaceChildren(plot);
    }
  }

  function path(x, y, px, py) {
    let text = "";
    for (let k = 0; k < x.length; k++) {
      if (Number.isFinite(y[k])) text += `${text ? "L" : "M"}${px(x[k]).toFixed(1)} ${py(y[k]).toFixed(1)}`;
    }
    return text;
  }

  return { Lines, element, figure, key, ticks, written };
})();
