"use strict";

/* Maps: the ground track with coast lines, and the surroundings of the target with the flights' ends. */
const Ground = (() => {
  const RADIAN = Math.PI / 180, { element, figure, ticks, written } = Chart;

  /* Lambert's azimuthal equal-area projection about a centre; in units of the planet's radius. */
  function projection(longitude0, latitude0) {
    const [sin0, cos0] = [Math.sin(latitude0 * RADIAN), Math.cos(latitude0 * RADIAN)];
    return (longitude, latitude) => {
      const l = (longitude - longitude0) * RADIAN, [sin, cos] = [Math.sin(latitude * RADIAN), Math.cos(latitude * RADIAN)];
      const k = Math.sqrt(2 / Math.max(1 + sin0 * sin + cos0 * cos * Math.cos(l), 1e-9));
      return [k * cos * Math.sin(l), -k * (cos0 * sin - sin0 * cos * Math.cos(l))];
    };
  }

  /* Points between, so that parallels are curves. */
  function along(from, to, count = 24) {
    return Array.from({ length: count + 1 }, (_, k) => [
      from[0] + k / count * (to[0] - from[0]), from[1] + k / count * (to[1] - from[1])]);
  }

  /* A ring whose edges are no longer than a degree: where the window cuts it they are parallels. */
  function dense(ring) {
    return ring.flatMap((point, k) => {
      const before = ring.at(k - 1), count = Math.ceil(Math.max(Math.abs(point[0] - before[0]), Math.abs(point[1] - before[1])));
      return count > 1 ? along(before, point, count).slice(1) : [point];
    });
  }

  /* Degrees with their side, on the turn that globes have. */
  function meridian(value, step) {
    const own = ((value + 540) % 360 + 360) % 360 - 180;
    return `${written(Math.abs(own), step)}°${own === 0 || Math.abs(own) === 180 ? "" : own < 0 ? " W" : " E"}`;
  }

  function parallel(value, step) {
    return `${written(Math.abs(value), step)}°${value === 0 ? "" : value < 0 ? " S" : " N"}`;
  }

  class Track {
    constructor(host, engine) {
      Object.assign(this, figure(host, "Ground track", "Coast lines: Natural Earth, public domain."));
      this.own.classList.add("wide");
      this.engine = engine;
      this.moving = null;
    }

    /* Everything that does not move, for the width there is. */
    lay() {
      const { west, east, south, north } = this.engine.window, width = this.own.clientWidth || 800;
      const project = projection(0.5 * (west + east), 0.5 * (south + north));
      const corners = [[west, south], [east, south], [east, north], [west, north]];
      const edge = corners.flatMap((corner, k) => along(corner, corners[(k + 1) % 4]));
      const places = edge.map(([x, y]) => project(x, y));
      const [xs, ys] = [places.map((p) => p[0]), places.map((p) => p[1])];
      const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
      const scale = Math.min(width / (x1 - x0), 520 / (y1 - y0));
      const left = 0.5 * (width - scale * (x1 - x0));
      this.point = (longitude, latitude) => {
        const [x, y] = project(longitude, latitude);
        return [left + scale * (x - x0), scale * (y - y0)];
      };
      const line = (points) => points.map(([x, y], k) => `${k ? "L" : "M"}${this.point(x, y).map((v) => v.toFixed(1)).join(" ")}`).join("");
      const plot = document.createDocumentFragment();
      element(plot, "path", { class: "sea", d: `${line(edge)}Z` });
      for (const ring of this.engine.coast) element(plot, "path", { class: "land", d: `${line(dense(ring))}Z` });
      this.graticule(plot, line, width);
      element(plot, "path", { class: "axis", d: `${line(edge)}Z` });
      this.moving = element(plot, "g");
      this.perKilometre = 1e3 * scale / this.engine.data.radius;
      this.svg.setAttribute("viewBox", `-2 -2 ${width + 4} ${scale * (y1 - y0) + 24}`);
      this.svg.replaceChildren(plot);
    }

    graticule(plot, line, width) {
      const { west, east, south, north } = this.engine.window, few = width < 500 ? 4 : 7;
      const across = ticks(west, east, few), up = ticks(south, north, few - 1);
      for (const x of across.values) {
        element(plot, "path", { class: "grid", d: line(along([x, south], [x, north])) });
        const [px, py] = this.point(x, south);
        if (px > 20 && px < width - 20) element(plot, "text", { x: px, y: py + 16, "text-anchor": "middle" }, meridian(x, across.step));
      }
      for (const y of up.values) {
        element(plot, "path", { class: "grid", d: line(along([west, y], [east, y])) });
        const [px, py] = this.point(west, y);
        element(plot, "text", { class: "halo", x: px + 7, y: py - 4 }, parallel(y, up.step));
      }
    }

    /* tracks: [{longitude, latitude, colour, dashed}]. */
    draw(tracks) {
      if (!this.moving) this.lay();
      const plot = document.createDocumentFragment(), { target } = this.engine;
      for (const { longitude, latitude, colour, dashed } of tracks) {
        let text = "";
        for (let k = 0; k < longitude.length; k += 2) text += this.step(longitude[k], latitude[k], text);
        text += this.step(longitude.at(-1), latitude.at(-1), text);
        element(plot, "path", { class: dashed ? "line dashed" : "line", style: `--own: var(--${colour})`, d: text });
      }
      const [x, y] = this.point(target.longitude, target.latitude);
      element(plot, "circle", { class: "ring", cx: x, cy: y, r: target.radii.at(-1) * this.perKilometre });
      element(plot, "path", { class: "target", d: `M${x - 6} ${y}h12M${x} ${y - 6}v12` });
      this.name(plot, "target", [x, y]);
      if (tracks.length) this.name(plot, "entry", this.point(tracks[0].longitude[0], tracks[0].latitude[0]));
      this.moving.replaceChildren(plot);
    }

    step(longitude, latitude, before) {
      const [x, y] = this.point(longitude, latitude);
      return `${before ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
    }

    /* A word above a point, or below it near the upper edge. */
    name(plot, text, [x, y]) {
      element(plot, "text", { class: "label halo", x, y: y > 30 ? y - 14 : y + 22, "text-anchor": "middle" }, text);
    }
  }

  /* Kilometres to the east and north of the target. */
  function local(target, radius) {
    const project = projection(target.longitude, target.latitude);
    return (longitude, latitude) => {
      const [x, y] = project(longitude, latitude);
      return [radius / 1e3 * x, -radius / 1e3 * y];
    };
  }

  return { Track, local };
})();
