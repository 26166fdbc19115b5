// Mounts every figure.pgv of the page: decodes its data when it first comes into sight, draws it with pgvRaster,
// turns, zooms and shifts it, names what is under the pointer and steps through the grasps.
"use strict";

const pgvViewer = (() => {
  const GRIPPER_ID = 100000; // ids below are layers
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((value) => value / (Math.hypot(...a) || 1));
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  const mix = (a, b, t) => a.map((value, k) => Math.round(value * (1 - t) + b[k] * t));

  let painted = null; // whose picture the shared raster holds
  let lastScroll = 0; // when the page itself last scrolled by wheel

  // Coordinates travel as little-endian uint16 over the layer's bounding box.
  function decode(layer) {
    const bytes = Uint8Array.from(atob(layer.xyz), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer), out = new Float32Array(bytes.length / 2);
    for (let i = 0; i < out.length; i++) {
      out[i] = layer.origin[i % 3] + view.getUint16(2 * i, true) * layer.step[i % 3];
    }
    return out;
  }

  class Viewer {
    constructor(figure) {
      this.figure = figure;
      this.canvas = figure.querySelector("canvas");
      this.tip = figure.querySelector(".pgv-tip");
      this.data = JSON.parse(figure.querySelector("script").textContent);
      this.clouds = null;
      this.group = this.data.group;
      this.grasp = this.data.grasps.length ? 0 : -1;
      this.hover = -1;
      this.pointers = new Map();
      this.seen = false;
      const u = this.data.up, helper = Math.abs(u[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
      this.east = unit(cross(helper, u));
      this.north = cross(u, this.east);
      this.reset();
      this.listen();
    }

    reset() {
      this.yaw = Math.atan2(dot(this.data.eye, this.north), dot(this.data.eye, this.east));
      this.pitch = Math.asin(clamp(dot(this.data.eye, this.data.up), -1, 1));
      this.zoom = 1;
      this.target = this.data.target.slice();
      this.draw();
    }

    view(width, height) {
      const c = Math.cos(this.pitch), s = Math.sin(this.pitch);
      const back = [0, 1, 2].map((k) => c * (Math.cos(this.yaw) * this.east[k] + Math.sin(this.yaw) * this.north[k])
        + s * this.data.up[k]);
      const right = [0, 1, 2].map((k) => Math.cos(this.yaw) * this.north[k] - Math.sin(this.yaw) * this.east[k]);
      const focal = Math.min(width, height) / (2 * Math.tan(this.data.field_of_view / 2));
      const distance = this.data.distance / this.zoom;
      return { right, up: cross(back, right), back, target: this.target, distance, focal };
    }

    draw(moving = false) {
      if (!this.seen || this.queued) return;
      this.queued = true;
      requestAnimationFrame(() => {
        this.queued = false;
        if (this.seen) this.paint(moving);
      });
      clearTimeout(this.settle);
      if (moving) this.settle = setTimeout(() => this.draw(), 160);
    }

    paint(moving) {
      const box = this.canvas.getBoundingClientRect();
      if (!box.width) return;
      this.clouds ??= this.data.layers.map(decode);
      // At rest twice the page's pixels, which the browser smooths; while it moves, the screen's own at most.
      this.scale = moving ? Math.min(1, devicePixelRatio) : 2;
      const width = Math.round(box.width * this.scale), height = Math.round(box.height * this.scale);
      if (this.canvas.width !== width) this.canvas.width = width;
      if (this.canvas.height !== height) this.canvas.height = height;
      const view = this.view(width, height), style = getComputedStyle(this.figure);
      const muted = style.getPropertyValue("--pgv-muted").split(",").map(Number);
      const grasp = this.data.grasps[this.grasp];
      pgvRaster.begin(width, height);
      // Slabs and their clusters share points, and what is drawn first wins: the grasped region leads.
      const order = this.data.layers.map((_, i) => i).sort((a, b) => this.rank(a) - this.rank(b));
      const dimmed = grasp && grasp.layer !== null && this.data.layers[grasp.layer].group === this.group;
      for (const i of order) {
        const layer = this.data.layers[i], active = layer.group !== null && layer.group === this.group;
        let rgb = active ? layer.rgb : layer.rgb ? mix(layer.rgb, muted, 0.6) : muted;
        if (active && dimmed && i !== grasp.layer) rgb = mix(rgb, muted, 0.4);
        if (active && i === this.hover) rgb = mix(rgb, [255, 255, 255], 0.35);
        pgvRaster.points(this.clouds[i], rgb, i, view, layer.radius, active ? 0 : layer.radius);
      }
      if (grasp && this.gripperShown()) {
        this.data.gripper.forEach((part, k) => {
          pgvRaster.mesh(part.vertices, part.faces, grasp.poses[k], part.rgb, GRIPPER_ID + k, view);
        });
      }
      const picture = pgvRaster.finish(0.05 * this.data.radius, Math.max(1, Math.round(this.scale)));
      this.canvas.getContext("2d").putImageData(picture, 0, 0);
      painted = this;
      this.ruler(view.focal / view.distance / this.scale);
    }

    rank(i) {
      return this.data.grasps[this.grasp]?.layer === i ? -1 : i;
    }

    gripperShown() {
      const box = this.figure.querySelector(".pgv-gripper input");
      return !box || box.checked;
    }

    ruler(pixelsPerMetre) {
      const bar = this.figure.querySelector(".pgv-ruler");
      const metres = [0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002].find((m) => m * pixelsPerMetre < 130) ?? 0.001;
      bar.style.width = `${metres * pixelsPerMetre}px`;
      bar.textContent = `${metres * 1000} mm`;
    }

    // What is at a place of the canvas, in page pixels from its corner: its id and its lines of text.
    at(x, y, reach) {
      if (painted !== this) this.paint(false);
      const [px, py, r] = [x, y, reach].map((value) => Math.round(value * this.scale));
      const id = pgvRaster.pick(px, py, r, (found) => this.lines(found).length > 0);
      return { id, lines: this.lines(id) };
    }

    lines(id) {
      if (id < GRIPPER_ID) return this.data.layers[id]?.text ?? [];
      const grasp = this.data.grasps[this.grasp];
      return [...this.data.gripper[id - GRIPPER_ID].text, ...grasp.text, ...grasp.terms];
    }

    name(event) {
      const box = this.canvas.getBoundingClientRect();
      const x = event.clientX - box.left, y = event.clientY - box.top;
      const { id, lines } = this.at(x, y, event.pointerType === "mouse" ? 3 : 9);
      this.tip.hidden = !lines.length;
      this.tip.replaceChildren(...lines.map((line) => Object.assign(document.createElement("div"), { textContent: line })));
      const left = clamp(x + 14, 4, Math.max(4, box.width - this.tip.offsetWidth - 4));
      const top = y + 18 + this.tip.offsetHeight > box.height ? y - this.tip.offsetHeight - 10 : y + 18;
      this.tip.style.transform = `translate(${left}px, ${Math.max(4, top)}px)`;
      const hover = id < GRIPPER_ID ? id : -1;
      if (hover !== this.hover) {
        this.hover = hover;
        this.draw();
      }
    }

    unname() {
      this.tip.hidden = true;
      if (this.hover !== -1) {
        this.hover = -1;
        this.draw();
      }
    }

    turn(dx, dy) {
      this.yaw -= 0.01 * dx;
      this.pitch = clamp(this.pitch + 0.01 * dy, -Math.PI / 2, Math.PI / 2);
      this.draw(true);
    }

    shift(dx, dy) {
      const box = this.canvas.getBoundingClientRect(), view = this.view(box.width, box.height);
      const metres = view.distance / view.focal;
      this.target = this.target.map((value, k) => value + metres * (dy * view.up[k] - dx * view.right[k]));
      this.draw(true);
    }

    scaleBy(factor) {
      const before = this.zoom;
      this.zoom = clamp(this.zoom * factor, 0.3, 12);
      this.draw(true);
      return this.zoom !== before;
    }

    choose(index) {
      this.grasp = index;
      const grasp = this.data.grasps[index];
      const output = this.figure.querySelector("output");
      if (output) output.textContent = `${index + 1} of ${this.data.grasps.length}: ${grasp.text.join(" · ")}`;
      this.draw();
    }

    listen() {
      const { canvas, figure, pointers } = this;
      const spread = () => {
        const [a, b] = [...pointers.values()];
        return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      };
      canvas.addEventListener("pointerdown", (event) => {
        pointers.set(event.pointerId, event);
        if (event.isTrusted) canvas.setPointerCapture(event.pointerId);
        this.unname();
        this.start = event;
        this.scrolls = false;
      });
      canvas.addEventListener("pointermove", (event) => {
        const last = pointers.get(event.pointerId);
        if (!last) {
          if (event.pointerType === "mouse") this.name(event);
          return;
        }
        const dx = event.clientX - last.clientX, dy = event.clientY - last.clientY;
        if (pointers.size === 1) {
          // A finger that sets out upwards or downwards scrolls the page; the browser may not have said so yet.
          if (event.pointerType === "touch" && last === this.start) this.scrolls = Math.abs(dy) > Math.abs(dx);
          if (this.scrolls) return;
          if (event.shiftKey || event.buttons & 2) this.shift(dx, dy);
          else this.turn(dx, dy);
          pointers.set(event.pointerId, event);
        } else if (pointers.size === 2) {
          const before = spread();
          pointers.set(event.pointerId, event);
          if (before > 0) this.scaleBy(spread() / before);
          this.shift(dx / 2, dy / 2);
        }
      });
      const release = (event) => {
        pointers.delete(event.pointerId);
        // A tap names what it touched: a finger cannot hover.
        const travel = Math.hypot(event.clientX - this.start.clientX, event.clientY - this.start.clientY);
        if (event.type === "pointerup" && event.pointerType !== "mouse" && travel < 8) this.name(event);
      };
      canvas.addEventListener("pointerup", release);
      canvas.addEventListener("pointercancel", release);
      canvas.addEventListener("pointerleave", (event) => {
        if (event.pointerType === "mouse") this.unname();
      });
      canvas.addEventListener("contextmenu", (event) => event.preventDefault());
      canvas.addEventListener("dblclick", () => this.reset());
      // A scroll that began on the page goes on past the viewer; one that begins here zooms.
      canvas.addEventListener("wheel", (event) => {
        const scrolling = !event.ctrlKey && event.timeStamp - lastScroll < 300;
        if (!scrolling && this.scaleBy(Math.exp(-clamp(event.deltaY, -120, 120) * 0.0022))) event.preventDefault();
      }, { passive: false });
      canvas.addEventListener("keydown", (event) => {
        const step = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] }[event.key];
        if (step) this.turn(...step);
        else if (event.key === "+" || event.key === "=") this.scaleBy(1.15);
        else if (event.key === "-") this.scaleBy(1 / 1.15);
        else if (event.key === "0" || event.key === "Home") this.reset();
        else return;
        event.preventDefault();
      });
      figure.querySelector(".pgv-reset").addEventListener("click", () => this.reset());
      for (const button of figure.querySelectorAll("[data-group]")) {
        button.addEventListener("click", () => {
          this.group = button.dataset.group;
          for (const other of figure.querySelectorAll("[data-group]")) {
            other.setAttribute("aria-pressed", String(other === button));
          }
          for (const legend of figure.querySelectorAll("[data-legend]")) {
            legend.hidden = legend.dataset.legend !== this.group;
          }
          this.draw();
        });
      }
      figure.querySelector(".pgv-gripper input")?.addEventListener("change", () => this.draw());
      figure.querySelector("input[type=range]")?.addEventListener("input", (event) => {
        this.choose(Number(event.target.value));
      });
      // Off-screen canvases give their memory back, so that a page can hold many.
      new IntersectionObserver(([entry]) => {
        this.seen = entry.isIntersecting;
        if (this.seen) this.draw();
        else this.canvas.width = this.canvas.height = 0;
      }, { rootMargin: "200px" }).observe(canvas);
      new ResizeObserver(() => this.draw()).observe(canvas);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    }
  }

  document.addEventListener("wheel", (event) => {
    if (!event.defaultPrevented) lastScroll = event.timeStamp;
  }, { passive: true });
  document.addEventListener("DOMContentLoaded", () => {
    for (const figure of document.querySelectorAll("figure.pgv")) figure.pgv = new Viewer(figure);
  });
  return Viewer;
})();
