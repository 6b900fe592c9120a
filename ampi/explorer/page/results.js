"use strict";

/* What flew, in numbers: the table, the bar of keys above the charts, and the sentences of the header. */
const Results = (() => {
  const CELLS = ["miss", "along", "across", "altitude", "time", "use"];
  const byId = (id) => document.getElementById(id);

  /* A column's place on the globe. */
  function place({ longitude, latitude }) {
    const west = ((longitude + 540) % 360) - 180;
    return `${Math.abs(latitude).toFixed(2)}° ${latitude < 0 ? "S" : "N"}, ${Math.abs(west).toFixed(2)}° ${west < 0 ? "W" : "E"}`;
  }

  class Table {
    /* plans: [{name, label, dashed}]. */
    constructor(plans) {
      byId("flown").tBodies[0].replaceChildren(...plans.map(({ name, label, dashed }) => {
        const row = document.createElement("tr"), head = document.createElement("th");
        row.id = `flown-${name}`;
        head.scope = "row";
        head.append(Chart.key(name, dashed, label));
        row.append(head, ...CELLS.map((cell) => Object.assign(document.createElement("td"), { id: `${cell}-${name}` })));
        return row;
      }));
      byId("key").replaceChildren(...plans.map(({ name, label, dashed }) => {
        const miss = Object.assign(document.createElement("b"), { id: `key-${name}` });
        return Chart.key(name, dashed, `${label} `, miss);
      }));
    }

    tell({ name, miss, along, across, altitude, seconds, arrives, use }) {
      const put = (cell, text) => { byId(`${cell}-${name}`).textContent = text.replace("-", "−"); };
      const [limit, peak] = Object.entries(use).reduce((most, own) => (own[1] > most[1] ? own : most));
      put("miss", arrives ? miss.toFixed(2) : "short");
      put("along", arrives ? along.toFixed(2) : "");
      put("across", arrives ? across.toFixed(2) : "");
      put("altitude", arrives ? altitude.toFixed(0) : "");
      put("time", seconds.toFixed(0));
      put("use", `${limit.replace(/_/g, " ")} ${peak.toFixed(2)}`);
      put("key", arrives ? `${miss < 10 ? miss.toFixed(2) : miss.toFixed(0)} km` : "short");
      byId(`use-${name}`).classList.toggle("over", peak > 1.001);
      byId(`flown-${name}`).classList.remove("waiting");
    }

    /* Until a flight has flown, its last numbers stand back. */
    wait(name) {
      byId(`flown-${name}`).classList.add("waiting");
      byId(`miss-${name}`).textContent = "flying";
      byId(`key-${name}`).textContent = "…";
    }
  }

  /* Where the flights are to go. */
  function target({ target: own }) {
    byId("target").textContent = `Target ${place(own)}, altitude ${(own.altitude / 1e3).toFixed(1)} km, at ${own.speed.toFixed(0)} m/s`;
  }

  function agreement({ ok, text, hole, largest }) {
    const badge = byId("agreement");
    badge.textContent = hole ? `${text}; a case beside this entry has no optimum` : text;
    badge.classList.toggle("bad", !ok || hole);
    badge.dataset.largest = largest;
  }

  /* Where the entry lies in the table. */
  function cells({ cell, clipped }, sliders, labels) {
    sliders.forEach((slider, k) => { slider.cell = cell[k]; });
    const outside = labels.filter((_, k) => cell[k].clipped);
    const text = clipped ? `Outside the hypercube in ${outside.join(", ")}: the reference is that of its boundary.`
      : "Inside the hypercube. Marks are the table's points, the bar is the cell.";
    if (byId("cell").textContent !== text) byId("cell").textContent = text; // it is read aloud
  }

  function leftOut(sentences) {
    byId("foot").replaceChildren(...sentences.map((text) => Object.assign(document.createElement("p"), { textContent: `Left out: ${text}.` })));
  }

  return { Table, target, agreement, cells, leftOut };
})();
