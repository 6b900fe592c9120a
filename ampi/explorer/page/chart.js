"use strict";

/* Line charts in SVG: nice ticks, a frame, lines by the colour of what they show. */
const Chart = (() => {
  const NS = "http://www.w3.org/2000/svg", HEIGHT = 250;
  const MARGIN = { left: 58, right: 14, top: 8, bottom: 40 };

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

  /* A figure with a heading; `extra` stands behind it. */
  function figure(host, heading, caption, extra = null) {
    const own = document.createElement("figure");
    const title = document.createElement("h3");
    title.textContent = heading;
    if (extra) title.append(extra);
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

  class Lines {
    constructor(host, { heading, x, y, caption = "", extra = null }) {
      Object.assign(this, { x, y }, figure(host, heading, caption, extra));
    }

    /* series: [{x, y, colour, thin}]; limits: [{y, label}]; zero: whether 0 is to be seen. */
    draw(series, { limits = [], range = null } = {}) {
      const width = this.own.clientWidth || 480, plot = document.createDocumentFragment();
      const [x0, x1] = range?.x ?? extent(series.map((own) => own.x), 0);
      const bounds = limits.map((own) => [own.y]);
      const [y0, y1] = range?.y ?? extent([...series.map((own) => own.y), ...bounds]);
      const right = width - MARGIN.right, bottom = HEIGHT - MARGIN.bottom;
      const px = (value) => MARGIN.left + (value - x0) / (x1 - x0) * (right - MARGIN.left);
      const py = (value) => bottom - (value - y0) / (y1 - y0) * (bottom - MARGIN.top);
      this.frame(plot, { x0, x1, y0, y1, px, py, right, bottom });
      for (const { y, label } of limits) {
        element(plot, "path", { class: "limit", d: `M${MARGIN.left} ${py(y)}H${right}` });
        element(plot, "text", { x: right - 4, y: py(y) - 4, "text-anchor": "end" }, label);
      }
      for (const own of series) {
        element(plot, "path", { class: own.thin ? "line thin" : "line", style: `--own: var(--${own.colour})`,
          d: path(own.x, own.y, px, py) });
      }
      this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
      this.svg.replaceChildren(plot);
      this.key(series.filter(({ label }) => label));
    }

    /* What the colours mean, where no table says it. */
    key(series) {
      if (!series.length || this.legend) return;
      this.legend = document.createElement("figcaption");
      this.legend.append(...series.map(({ colour, label }) => {
        const own = document.createElement("span");
        own.className = "key";
        own.style.setProperty("--own", `var(--${colour})`);
        own.textContent = label;
        return own;
      }));
      this.own.append(this.legend);
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
      element(plot, "path", { class: "axis", d: `M${MARGIN.left} ${MARGIN.top}V${bottom}H${right}` });
      element(plot, "text", { class: "label", x: right, y: bottom + 34, "text-anchor": "end" }, this.x);
      const middle = 0.5 * (MARGIN.top + bottom);
      element(plot, "text", { class: "label", "text-anchor": "middle", transform: `rotate(-90) translate(${-middle} 13)` }, this.y);
    }
  }

  function path(x, y, px, py) {
    let text = "";
    for (let k = 0; k < x.length; k++) {
      if (Number.isFinite(y[k])) text += `${text ? "L" : "M"}${px(x[k]).toFixed(1)} ${py(y[k]).toFixed(1)}`;
    }
    return text;
  }

  return { Lines, element, figure, ticks, written, extent };
})();
