// A software rasteriser for point clouds: discs and flat-shaded triangles with a depth and an id for every pixel.
// Pages may hold hundreds of viewers; WebGL allows about sixteen contexts, this one set of buffers serves them all.
"use strict";

const pgvRaster = (() => {
  let width = 0, height = 0, image = null;
  let colour, depth, ids; // the points
  let overColour, overDepth, overIds; // the gripper, blended over the points so that they shine through
  const GRIPPER_ALPHA = 0.86;

  function begin(w, h) {
    if (w !== width || h !== height) {
      width = w;
      height = h;
      image = new ImageData(w, h);
      colour = new Uint32Array(image.data.buffer);
      depth = new Float32Array(w * h);
      ids = new Int32Array(w * h);
      overColour = new Uint32Array(w * h);
      overDepth = new Float32Array(w * h);
      overIds = new Int32Array(w * h);
    }
    colour.fill(0);
    depth.fill(Infinity);
    ids.fill(-1);
    overDepth.fill(Infinity);
    overIds.fill(-1);
  }

  // For discs of radius k/2 pixels: half the width of each row, from the top row down.
  const discs = Array.from({ length: 41 }, (_, k) => {
    const r = k / 2, rows = [];
    for (let y = -Math.floor(r); y <= Math.floor(r); y++) rows.push(Math.floor(Math.sqrt(r * r - y * y)));
    return rows;
  });

  const pack = ([r, g, b]) => (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;

  // view: {right, up, back: unit vectors, target, distance, focal (pixels)}; xyz: Float32Array, three numbers a point;
  // radius of the discs and how far behind their place they are drawn, metres: what lies in front of its double wins.
  function points(xyz, rgb, id, view, radius, behind) {
    const [rx, ry, rz] = view.right, [ux, uy, uz] = view.up, [bx, by, bz] = view.back;
    const [tx, ty, tz] = view.target, f = view.focal, near = 0.02 * view.distance, paint = pack(rgb);
    for (let i = 0; i < xyz.length; i += 3) {
      const x = xyz[i] - tx, y = xyz[i + 1] - ty, z = xyz[i + 2] - tz;
      const d = view.distance - (bx * x + by * y + bz * z) + behind;
      if (d < near) continue;
      const px = Math.round(width / 2 + (f * (rx * x + ry * y + rz * z)) / d);
      const py = Math.round(height / 2 - (f * (ux * x + uy * y + uz * z)) / d);
      const k = Math.max(1, Math.min(40, Math.round((2 * radius * f) / d)));
      const rows = discs[k], reach = (rows.length - 1) / 2;
      if (px < -reach || py < -reach || px >= width + reach || py >= height + reach) continue;
      for (let j = 0; j < rows.length; j++) {
        const row = py - reach + j;
        if (row < 0 || row >= height) continue;
        const first = Math.max(0, px - rows[j]), last = Math.min(width - 1, px + rows[j]);
        for (let at = row * width + first; at <= row * width + last; at++) {
          if (d < depth[at]) {
            depth[at] = d;
            colour[at] = paint;
            ids[at] = id;
          }
        }
      }
    }
  }

  // vertices: flat array in the part's frame; pose: the 12 numbers of [R | t], row by row, part to cloud.
  function mesh(vertices, faces, pose, rgb, id, view) {
    const n = vertices.length / 3, eye = new Float32Array(3 * n), screen = new Float32Array(3 * n);
    const { right, up, back, target, distance, focal } = view;
    for (let i = 0; i < n; i++) {
      const p = [0, 1, 2].map((k) => pose[4 * k] * vertices[3 * i] + pose[4 * k + 1] * vertices[3 * i + 1]
        + pose[4 * k + 2] * vertices[3 * i + 2] + pose[4 * k + 3] - target[k]);
      const along = (axis) => axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2];
      eye[3 * i] = along(right);
      eye[3 * i + 1] = along(up);
      eye[3 * i + 2] = along(back) - distance; // the camera looks along -z
      screen[3 * i] = width / 2 - (focal * eye[3 * i]) / eye[3 * i + 2];
      screen[3 * i + 1] = height / 2 + (focal * eye[3 * i + 1]) / eye[3 * i + 2];
      screen[3 * i + 2] = -1 / eye[3 * i + 2]; // 1 / depth is linear on the screen
    }
    for (let i = 0; i < faces.length; i += 3) triangle(eye, screen, faces[i], faces[i + 1], faces[i + 2], rgb, id, view);
  }

  function triangle(eye, screen, a, b, c, rgb, id, view) {
    const near = 0.02 * view.distance;
    if (-eye[3 * a + 2] < near || -eye[3 * b + 2] < near || -eye[3 * c + 2] < near) return;
    const ax = screen[3 * a], ay = screen[3 * a + 1], bx = screen[3 * b], by = screen[3 * b + 1];
    const cx = screen[3 * c], cy = screen[3 * c + 1];
    const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (area >= 0) return; // y points down: triangles that face the camera turn the negative way
    const u = [0, 1, 2].map((k) => eye[3 * b + k] - eye[3 * a + k]);
    const v = [0, 1, 2].map((k) => eye[3 * c + k] - eye[3 * a + k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const light = (-0.35 * n[0] + 0.62 * n[1] + 0.7 * n[2]) / (Math.hypot(n[0], n[1], n[2]) || 1);
    const shade = 0.6 + 0.4 * Math.max(0, light);
    const paint = pack(rgb.map((value) => Math.round(value * shade)));
    const y0 = Math.max(0, Math.ceil(Math.min(ay, by, cy))), y1 = Math.min(height - 1, Math.floor(Math.max(ay, by, cy)));
    const x0 = Math.max(0, Math.ceil(Math.min(ax, bx, cx))), x1 = Math.min(width - 1, Math.floor(Math.max(ax, bx, cx)));
    const ia = screen[3 * a + 2], ib = screen[3 * b + 2], ic = screen[3 * c + 2];
    for (let y = y0; y <= y1; y++) {
      for (let x = x0; x <= x1; x++) {
        const wa = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area;
        const wb = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area;
        const wc = 1 - wa - wb;
        if (wa < 0 || wb < 0 || wc < 0) continue;
        const d = 1 / (wa * ia + wb * ib + wc * ic), at = y * width + x;
        if (d < overDepth[at]) {
          overDepth[at] = d;
          overColour[at] = paint;
          overIds[at] = id;
        }
      }
    }
  }

  // Darkens each point pixel by how far its neighbours stand in front of it (eye-dome lighting), so that shape
  // shows without normals; then lays the gripper over. `step` is in metres: the depth difference that counts fully.
  function finish(step, reach) {
    const offsets = [-reach, reach, -reach * width, reach * width];
    for (let y = 0; y < height; y++) {
      const inner = y >= reach && y < height - reach;
      for (let x = 0; x < width; x++) {
        const at = y * width + x;
        const d = depth[at];
        if (d !== Infinity && inner && x >= reach && x < width - reach) {
          let hidden = 0;
          for (let k = 0; k < 4; k++) {
            const gap = d - depth[at + offsets[k]];
            if (gap > 0) hidden += gap < step ? gap : step;
          }
          if (hidden > 0) colour[at] = scale(colour[at], 1 / (1 + (0.45 * hidden) / step));
        }
        const over = overDepth[at];
        if (over === Infinity || over > d) continue;
        colour[at] = d === Infinity ? overColour[at] : blend(colour[at], overColour[at], GRIPPER_ALPHA);
        ids[at] = overIds[at];
      }
    }
    return image;
  }

  const scale = (c, s) => 0xff000000 | (((c >> 16) & 255) * s) << 16 | (((c >> 8) & 255) * s) << 8 | (c & 255) * s;
  const blend = (c, o, a) => {
    const mix = (shift) => ((c >> shift) & 255) * (1 - a) + ((o >> shift) & 255) * a;
    return 0xff000000 | (mix(16) << 16) | (mix(8) << 8) | mix(0);
  };

  // The id at a pixel, or the nearest one within `reach` pixels, of those that `named` accepts; -1 where there is none.
  function pick(px, py, reach, named) {
    let best = -1, nearest = Infinity;
    for (let y = Math.max(0, py - reach); y <= Math.min(height - 1, py + reach); y++) {
      for (let x = Math.max(0, px - reach); x <= Math.min(width - 1, px + reach); x++) {
        const away = (x - px) ** 2 + (y - py) ** 2, id = ids[y * width + x];
        if (id >= 0 && away < nearest && named(id)) {
          nearest = away;
          best = id;
        }
      }
    }
    return best;
  }

  return { begin, points, mesh, finish, pick };
})();
