"use strict";

/* The table: unpacked (packed_table.py), as the blobs that the flight code opens (ampi/export/blob.py), and
   interpolated by the page itself: Sagliano et al. 2016, Eqs. (16) to (19) and (30) to (33). */
const Table = (() => {
  const HEADER = 32, SIZES = 64, LENGTH_AT = 16, CHECKSUM_AT = 20, TURN = 2 * Math.PI;

  function bytesOf(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }

  async function inflated(text) {
    const stream = new Blob([bytesOf(text)]).stream()
      .pipeThrough(new DecompressionStream("deflate-raw"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /* Values [vertices][columns]: differences along every axis, summed up again. */
  async function unpacked({ shape, least, step, planes }) {
    const bytes = await inflated(planes);
    const size = bytes.length / 4, columns = shape[shape.length - 1], rows = least.length - 1;
    const steps = new Int32Array(size), values = new Float64Array(size);
    for (let k = 0; k < size; k++) {
      const zigzag = bytes[k] | bytes[size + k] << 8 | bytes[2 * size + k] << 16 | bytes[3 * size + k] << 24;
      steps[k] = (zigzag >>> 1) ^ -(zigzag & 1);
    }
    for (let axis = shape.length - 2, stride = columns; axis >= 0; stride *= shape[axis], axis--) {
      for (let k = 0; k < size; k++) {
        if (Math.floor(k / stride) % shape[axis] > 0) steps[k] += steps[k - stride];
      }
    }
    for (let k = 0; k < size; k++) {
      const column = k % columns, row = column === columns - 1 ? rows : column % rows;
      values[k] = least[row] + step[row] * steps[k];
    }
    return values;
  }

  const crcTable = Uint32Array.from({ length: 256 }, (_, byte) => {
    for (let bit = 0; bit < 8; bit++) byte = byte & 1 ? byte >>> 1 ^ 0xEDB88320 : byte >>> 1;
    return byte;
  });

  function crc32(bytes) {
    let crc = 0xFFFFFFFF;
    for (let k = 0; k < bytes.length; k++) crc = crc >>> 8 ^ crcTable[(crc ^ bytes[k]) & 255];
    return (crc ^ 0xFFFFFFFF) >>> 0;
  }

  /* The blob of a mode: what is its own, what all share, values, holes. */
  function blobOf(own, shared, values, columns, holes) {
    const part = new Float64Array(own.vertices.length * columns);
    own.vertices.forEach((vertex, k) => {
      part.set(values.subarray(vertex * columns, (vertex + 1) * columns), k * columns);
    });
    const blob = new Uint8Array(own.head.length + shared.length + part.byteLength + holes.length);
    blob.set(own.head);
    blob.set(shared, own.head.length);
    blob.set(new Uint8Array(part.buffer), own.head.length + shared.length);
    blob.set(holes, blob.length - holes.length);
    const view = new DataView(blob.buffer);
    view.setUint32(LENGTH_AT, blob.length - HEADER, true);
    view.setUint32(CHECKSUM_AT, crc32(blob.subarray(HEADER)), true);
    return blob;
  }

  /* Sizes, axes, segments and matrices of a blob, as its format says. */
  function read(blob) {
    const view = new DataView(blob.buffer), u32 = (at) => view.getUint32(at, true);
    const f64 = (at) => view.getFloat64(at, true), size = (k) => u32(HEADER + 4 * k);
    const numbers = (at, count) => Float64Array.from({ length: count }, (_, k) => f64(at + 8 * k));
    const table = { rows: size(3), nodes: size(4), points: size(5), clips: size(8) !== 0, axes: [], segments: [] };
    let at = HEADER + SIZES + Math.ceil(size(14) / 8) * 8;
    for (let k = 0; k < size(2); k++, at += 40) {
      table.axes.push({ count: u32(at), order: u32(at + 4), circular: u32(at + 8) !== 0,
        low: f64(at + 16), high: f64(at + 24), nominal: f64(at + 32) });
    }
    for (let k = 0, node = 0, point = 0; k < size(6); k++, at += 48) {
      table.segments.push({ nodes: u32(at), points: u32(at + 4), firstNode: node, firstPoint: point });
      node += u32(at) - 1; // neighbours share one
      point += u32(at + 4);
    }
    at += 8 * (4 + 6 + 14 + 16);
    for (const axis of table.axes) {
      axis.points = numbers(at, axis.count);
      at += 8 * axis.count;
    }
    for (const segment of table.segments) {
      at += 16 * size(7);
      segment.matrix = numbers(at, segment.nodes * segment.points);
      at += 8 * segment.nodes * segment.points;
    }
    table.fixed = numbers(at, table.points);
    table.free = numbers(at + 8 * table.points, table.points);
    table.columns = table.rows * table.nodes + 1;
    table.values = new Float64Array(blob.slice(at + 16 * table.points).buffer, 0,
      table.columns * table.axes.reduce((product, axis) => product * axis.count, 1));
    return table;
  }

  /* Where a parameter lies on an axis: first point and weights; whether it is outside. */
  function located(axis, told) {
    const middle = 0.5 * (axis.low + axis.high);
    const turned = axis.circular ? told - TURN * Math.round((told - middle) / TURN) : told;
    const size = 1e-14 * Math.max(Math.abs(axis.low), Math.abs(axis.high), axis.circular ? TURN : 0);
    const clipped = turned < axis.low - size || turned > axis.high + size;
    const points = axis.points, n = axis.count;
    const inside = Math.min(Math.max(turned, points[0]), points[n - 1]);
    let cell = 0;
    for (let j = 1; j + 1 < n; j++) cell += points[j] <= inside ? 1 : 0;
    const width = Math.min(axis.order, n);
    if (width === 1) {
      const nearer = n > 1 && inside - points[cell] > points[cell + 1] - inside ? cell + 1 : cell;
      return { clipped, cell, first: nearer, weights: [1] };
    }
    const back = width === 3 ? cell % 2 : width === 4 && cell > 0 ? 1 : 0;
    const first = Math.min(cell - back, n - width);
    const weights = Array.from({ length: width }, (_, i) => {
      let weight = 1;
      for (let j = 0; j < width; j++) {
        if (j !== i) weight *= (inside - points[first + j]) / (points[first + i] - points[first + j]);
      }
      return weight;
    });
    return { clipped, cell, first, weights };
  }

  /* found += weight × a vertex. */
  function addVertex(found, values, begin, weight) {
    for (let k = 0; k < found.length; k++) found[k] += weight * values[begin + k];
  }

  /* Nodal values [columns] of parameters (SI): the weighted sum of the vertices of the subspace. */
  function nodal(table, parameters) {
    const places = table.axes.map((axis, k) => located(axis, parameters[k]));
    const found = new Float64Array(table.columns);
    const add = (axis, vertex, weight) => {
      if (axis === places.length) {
        addVertex(found, table.values, vertex * table.columns, weight);
        return;
      }
      const { first, weights } = places[axis], count = table.axes[axis].count;
      weights.forEach((own, k) => add(axis + 1, vertex * count + first + k, weight * own));
    };
    add(0, 0, 1);
    return { values: found, finalTime: found[table.columns - 1], places };
  }

  /* Row `row` at the high-density points: the matrix of each segment times its nodes. */
  function highDensity(table, values, row) {
    const found = new Float64Array(table.points);
    for (const segment of table.segments) {
      for (let node = 0; node < segment.nodes; node++) {
        const value = values[(segment.firstNode + node) * table.rows + row], begin = node * segment.points;
        for (let k = 0; k < segment.points; k++) {
          found[segment.firstPoint + k] += value * segment.matrix[begin + k];
        }
      }
    }
    return found;
  }

  function times(table, finalTime) {
    return table.fixed.map((fixed, k) => fixed + table.free[k] * finalTime);
  }

  return { bytesOf, inflated, unpacked, blobOf, read, nodal, highDensity, times };
})();
