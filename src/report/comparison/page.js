"use strict";

// The videos of one scene, played by one clock.
class Stage {
  constructor(section) {
    this.section = section;
    this.frames = Number(section.dataset.frames);
    this.fps = Number(section.dataset.fps);
    this.find = (name) => section.querySelector(name);
    this.playing = false;
    this.time = 0; // seconds into the scene
    this.tick = this.tick.bind(this);
    this.listen();
    this.show(0);
  }

  // Those with something to play; the two of the wipe only while it is open.
  get videos() {
    return [...this.section.querySelectorAll("video")].filter((video) => video.src && video.readyState > 0);
  }

  get frame() {
    return Math.min(this.frames - 1, Math.floor(this.time * this.fps + 1e-6));
  }

  get speed() {
    return Number(this.find(".speed").value);
  }

  listen() {
    this.find(".play").addEventListener("click", () => this.toggle());
    this.find(".scrub").addEventListener("input", (event) => this.show(Number(event.target.value)));
    this.find(".speed").addEventListener("change", () => this.rebase());
    this.find(".zoom").addEventListener("input", (event) => this.section.style.setProperty("--zoom", event.target.value));
    for (const button of this.section.querySelectorAll(".worst")) {
      button.addEventListener("click", () => this.show(Number(button.dataset.frame)));
    }
    for (const view of this.section.querySelectorAll(".view, .stage")) this.pan(view);
    for (const video of this.section.querySelectorAll("video")) {
      video.addEventListener("loadedmetadata", () => this.seek(video));
    }
    const wipe = this.find(".wipe");
    if (wipe) this.wipe(wipe);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.frame >= this.frames - 1) this.time = 0;
    this.playing = true;
    this.rebase();
    this.label();
    requestAnimationFrame(this.tick);
  }

  pause() {
    this.playing = false;
    this.label();
    this.show(this.frame);
  }

  // The clock starts anew from here.
  rebase() {
    this.from = { time: this.time, now: performance.now() };
  }

  label() {
    const button = this.find(".play");
    button.textContent = this.playing ? "Pause" : "Play";
    button.setAttribute("aria-pressed", String(this.playing));
  }

  // Stops at a frame.
  show(frame) {
    this.playing = false;
    this.label();
    this.time = Math.max(0, Math.min(this.frames - 1, frame)) / this.fps;
    for (const video of this.videos) {
      video.pause();
      this.seek(video);
    }
    this.tell();
  }

  // The middle of the frame: its edges belong to two.
  seek(video) {
    const last = (video.duration || this.frames / this.fps) - 0.5 / this.fps;
    video.currentTime = Math.max(0, Math.min(last, (this.frame + 0.5) / this.fps));
  }

  tick(now) {
    if (!this.playing) return;
    const length = this.frames / this.fps;
    let time = this.from.time + ((now - this.from.now) / 1000) * this.speed;
    if (time >= length) {
      if (!this.find(".loop").checked) {
        this.show(this.frames - 1);
        return;
      }
      time %= length;
      this.from = { time, now };
    }
    this.time = Math.max(0, time);
    for (const video of this.videos) this.follow(video);
    this.tell();
    requestAnimationFrame(this.tick);
  }

  // A little behind or ahead is caught up by pace, more by a jump.
  follow(video) {
    const ends = video.duration - 0.5 / this.fps;
    const due = this.time + 0.5 / this.fps;
    if (due >= ends) {
      if (!video.paused) video.pause();
      if (Math.abs(video.currentTime - ends) > 1 / this.fps && !video.seeking) video.currentTime = ends;
      return;
    }
    const behind = due - video.currentTime;
    if (Math.abs(behind) > 0.75 / this.fps && !video.seeking) video.currentTime = due;
    const pace = this.speed * (1 + Math.max(-0.2, Math.min(0.2, behind * 2)));
    if (Math.abs(video.playbackRate - pace) > 0.01) video.playbackRate = pace;
    if (video.paused) video.play().catch(() => {});
  }

  tell() {
    const scrub = this.find(".scrub");
    scrub.value = String(this.frame);
    this.find(".frame").textContent = `${this.frame} / ${this.frames - 1}`;
  }

  // All zoomed videos show the same part.
  pan(view) {
    const part = { x: 50, y: 50 };
    const move = (dx, dy) => {
      const style = getComputedStyle(this.section);
      part.x = parseFloat(style.getPropertyValue("--x")) || 50;
      part.y = parseFloat(style.getPropertyValue("--y")) || 50;
      const within = (v) => Math.max(0.01, Math.min(100, v));
      this.section.style.setProperty("--x", `${within(part.x + dx)}%`);
      this.section.style.setProperty("--y", `${within(part.y + dy)}%`);
    };
    view.addEventListener("pointerdown", (event) => view.setPointerCapture(event.pointerId));
    view.addEventListener("pointermove", (event) => {
      const zoom = Number(this.find(".zoom").value);
      if (!view.hasPointerCapture(event.pointerId) || zoom <= 1) return;
      const scale = 100 / (zoom - 1);
      move((-event.movementX / view.clientWidth) * scale, (-event.movementY / view.clientHeight) * scale);
    });
    view.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, -5], ArrowDown: [0, 5] };
      const step = steps[event.key];
      if (!step) return;
      event.preventDefault();
      move(...step);
    });
  }

  wipe(wipe) {
    const [left, right] = wipe.querySelectorAll(".choice");
    const sides = [
      [left, wipe.querySelector(".left")],
      [right, wipe.querySelector(".right")],
    ];
    const load = () => {
      for (const [choice, video] of sides) {
        if (!wipe.open) {
          video.removeAttribute("src");
          video.load();
        } else if (video.getAttribute("src") !== choice.value) {
          video.src = choice.value;
        }
      }
    };
    wipe.addEventListener("toggle", load);
    for (const [choice] of sides) choice.addEventListener("change", load);
    wipe.querySelector(".border").addEventListener("input", (event) => {
      wipe.style.setProperty("--border", `${event.target.value}%`);
    });
  }
}

// What a measure is, shown where it is pointed at or come to by keyboard.
class Tip {
  constructor() {
    this.box = document.createElement("div");
    this.box.className = "tip";
    this.box.setAttribute("aria-hidden", "true"); // read out as the button's description
    this.box.hidden = true;
    document.body.append(this.box);
    for (const term of document.querySelectorAll(".term")) {
      for (const event of ["pointerenter", "focus"]) term.addEventListener(event, () => this.show(term));
      for (const event of ["pointerleave", "blur"]) term.addEventListener(event, () => this.hide());
    }
    window.addEventListener("scroll", () => this.hide(), { passive: true, capture: true });
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.hide();
    });
  }

  show(term) {
    const text = document.getElementById(term.getAttribute("aria-describedby"));
    if (!text) return;
    this.box.textContent = text.textContent;
    this.box.hidden = false;
    const at = term.getBoundingClientRect();
    const { offsetWidth: width, offsetHeight: height } = this.box;
    const left = Math.max(8, Math.min(at.left, document.documentElement.clientWidth - width - 8));
    const below = at.bottom + 6;
    this.box.style.left = `${left}px`;
    this.box.style.top = `${below + height < window.innerHeight ? below : Math.max(8, at.top - height - 6)}px`;
  }

  hide() {
    this.box.hidden = true;
  }
}

new Tip();

const stages = [...document.querySelectorAll("section.scene")].map((section) => new Stage(section));

// The scene whose middle is nearest to the window's.
function inView() {
  const middle = window.innerHeight / 2;
  const away = (stage) => {
    const { top, bottom } = stage.section.getBoundingClientRect();
    return top <= middle && bottom >= middle ? 0 : Math.min(Math.abs(top - middle), Math.abs(bottom - middle));
  };
  return stages.reduce((a, b) => (away(b) < away(a) ? b : a));
}

document.addEventListener("keydown", (event) => {
  const busy = event.target.closest("input, select, button, summary, a");
  if (!stages.length || busy || event.ctrlKey || event.metaKey || event.altKey) return;
  const stage = inView();
  const step = { ",": -1, ".": 1 }[event.key];
  if (event.key === " ") stage.toggle();
  else if (step) stage.show(stage.frame + step);
  else return;
  event.preventDefault();
});
