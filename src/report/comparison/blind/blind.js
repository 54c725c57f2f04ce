"use strict";

const test = JSON.parse(document.getElementById("test").textContent);
const at = (id) => document.getElementById(id);

// Seconds that both are hidden between two plays, so that nobody sees who jumps at the end.
const GAP = 0.5;
// Share of a video that must have been played before a vote.
const WHOLE = 0.9;
// Seconds that the right video may be away from the left one before it jumps.
const LOST = 0.3;
// Pairs between two repeats, and least pairs between a pair and its repeat.
const REPEAT_EVERY = 7;
const APART = 4;

// Numbers in 0..1 that follow from a session's name (sfc32, by Chris Doty-Humphrey).
function random(session) {
  let [a, b, c, d] = [parseInt(session.slice(0, 8), 16), parseInt(session.slice(8), 16), 0x9e3779b9, 1];
  const next = () => {
    const t = (a + b + d) | 0;
    d = (d + 1) | 0;
    a = b ^ (b >>> 9);
    b = (c + (c << 3)) | 0;
    c = ((c << 21) | (c >>> 11)) + t;
    c |= 0;
    return (t >>> 0) / 4294967296;
  };
  for (let i = 0; i < 20; i++) next();
  return next;
}

function newSession() {
  const bytes = crypto.getRandomValues(new Uint8Array(8));
  return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

// Every pair of every scene once, by chance, but so that whoever stops early has seen scenes and videos equally often, each
// as often left as right; now and then one comes again with sides swapped.
function schedule(session) {
  const chance = random(session);
  const open = [];
  test.scenes.forEach((scene, s) => {
    const all = scene.videos.length * (scene.videos.length - 1) / 2;
    scene.videos.forEach((a, i) => scene.videos.slice(0, i).forEach((b) => open.push({ scene: s, a, b, all })));
  });
  const seen = new Map();
  const left = new Map();
  const count = (map, key, more = 0) => map.set(key, (map.get(key) || 0) + more).get(key);
  const cost = (pair) => count(seen, pair.scene) / pair.all * 1e6 + count(seen, pair.a) + count(seen, pair.b);
  const order = [];
  const fresh = [];
  let repeats = 0;
  while (open.length) {
    const least = Math.min(...open.map(cost));
    const next = open.filter((pair) => cost(pair) <= least + 1e-6);
    const pair = next[Math.floor(chance() * next.length)];
    open.splice(open.indexOf(pair), 1);
    for (const key of [pair.scene, pair.a, pair.b]) count(seen, key, 1);
    const more = count(left, pair.a) - count(left, pair.b);
    const swap = more > 0 || (more === 0 && chance() < 0.5);
    const shown = { scene: pair.scene, left: swap ? pair.b : pair.a, right: swap ? pair.a : pair.b };
    count(left, shown.left, 1);
    order.push(shown);
    fresh.push({ shown, place: order.length });
    const due = fresh.length && (order.length - repeats) % REPEAT_EVERY === 0;
    if (due || (!open.length && !repeats)) {
      const old = fresh.filter((entry) => !entry.again && order.length - entry.place >= Math.min(APART, order.length - 1));
      const again = old[Math.floor(chance() * old.length)];
      if (again && order.length > 2) {
        again.again = true;
        repeats += 1;
        order.push({ scene: again.shown.scene, left: again.shown.right, right: again.shown.left });
      }
    }
  }
  return order;
}

// What this browser remembers.
const store = {
  key: `enliven-votes-${test.comparison}`,
  load() {
    try {
      const state = JSON.parse(localStorage.getItem(this.key));
      return Array.isArray(state.votes) && /^[0-9a-f]{16}$/.test(state.session) ? state : null;
    } catch {
      return null;
    }
  },
  save(state) {
    try {
      localStorage.setItem(this.key, JSON.stringify(state));
    } catch {
      tell("This browser keeps nothing: save your votes before you close the page.");
    }
  },
  clear() {
    try {
      localStorage.removeItem(this.key);
    } catch {
      // Nothing was kept.
    }
  },
};

function tell(text) {
  at("message").textContent = text;
}

// Two videos played together, again and again. The right one keeps to the left one by its pace, not by jumps, which would be
// seen; on a slow machine both take longer.
class Pair {
  constructor(whenChanged, whenBroken) {
    this.videos = [at("left"), at("right")];
    this.box = at("pair");
    this.whenChanged = whenChanged;
    this.turn = 0;
    for (const video of this.videos) video.addEventListener("error", () => video.getAttribute("src") && whenBroken());
    document.addEventListener("visibilitychange", () => this.scene && this.restart());
  }

  show({ scene, left, right }) {
    this.scene = test.scenes[scene];
    this.loaded = false;
    this.seen = false;
    this.box.style.setProperty("--ratio", this.scene.ratio);
    this.box.classList.add("hidden");
    [left, right].forEach((source, i) => {
      this.videos[i].src = source;
      this.videos[i].load();
    });
    this.restart();
  }

  stop() {
    this.turn += 1;
    this.scene = null;
    for (const video of this.videos) {
      video.removeAttribute("src");
      video.load();
    }
  }

  // Both from the start, when both are there.
  async restart() {
    const turn = (this.turn += 1);
    this.box.classList.add("hidden");
    for (const video of this.videos) {
      video.pause();
      video.playbackRate = 1;
      video.currentTime = 0;
    }
    const ready = () => this.videos.every((video) => video.readyState >= 3 && !video.seeking);
    while (!ready() || document.hidden) {
      await new Promise((done) => setTimeout(done, 20));
      if (turn !== this.turn) return;
    }
    this.loaded = true;
    this.whenChanged();
    this.box.classList.remove("hidden");
    for (const video of this.videos) video.play().catch(() => {});
    const tick = () => {
      if (turn !== this.turn) return;
      if (this.step()) requestAnimationFrame(tick);
      else this.rest(turn);
    };
    requestAnimationFrame(tick);
  }

  // Keeps both together; whether either still has something to show.
  step() {
    const [left, right] = this.videos;
    const frame = 1 / this.scene.fps;
    const over = (video) => video.ended || video.currentTime >= this.scene.seconds - frame / 2;
    for (const video of this.videos) if (over(video) && !video.paused) video.pause();
    if (!over(left) && !over(right) && !left.seeking && !right.seeking) {
      const behind = left.currentTime - right.currentTime;
      if (Math.abs(behind) > LOST) right.currentTime = left.currentTime;
      const pace = Math.abs(behind) < frame / 4 ? 1 : 1 + Math.max(-0.1, Math.min(0.1, behind));
      if (Math.abs(right.playbackRate - pace) > 0.005) right.playbackRate = pace;
    }
    return !over(left) || !over(right);
  }

  rest(turn) {
    this.box.classList.add("hidden");
    if (!this.seen && this.videos.every((video) => played(video) >= WHOLE * this.scene.seconds)) {
      this.seen = true;
      this.whenChanged();
    }
    setTimeout(() => turn === this.turn && this.restart(), GAP * 1000);
  }
}

// Seconds of a video that have been played, each once.
function played(video) {
  let sum = 0;
  for (let i = 0; i < video.played.length; i++) sum += video.played.end(i) - video.played.start(i);
  return sum;
}

// One person's way through the pairs.
class Sitting {
  constructor() {
    this.state = store.load() || { session: newSession(), voter: "", votes: [] };
    this.order = schedule(this.state.session);
    this.pair = new Pair(() => this.label(), () => this.broken());
    this.buttons = [...document.querySelectorAll("[data-choice]")];
    this.listen();
    this.welcome();
  }

  get votes() {
    return this.state.votes.filter((vote) => vote.choice !== "skipped");
  }

  listen() {
    at("begin").addEventListener("click", () => this.begin());
    at("voter").addEventListener("keydown", (event) => event.key === "Enter" && this.begin());
    at("anew").addEventListener("click", () => {
      store.clear();
      location.reload();
    });
    for (const button of this.buttons) {
      button.addEventListener("click", (event) => {
        // After a click of the mouse the space bar should not press this button again.
        if (event.detail > 0) button.blur();
        this.vote(button.dataset.choice);
      });
    }
    at("undo").addEventListener("click", () => this.undo());
    at("skip").addEventListener("click", () => this.record("skipped"));
    at("save").addEventListener("click", () => this.save());
    document.addEventListener("keydown", (event) => this.press(event));
  }

  welcome() {
    at("voter").value = this.state.voter;
    if (!this.state.votes.length) return;
    at("begin").textContent = "Go on";
    at("anew").hidden = false;
    tell(`${this.votes.length} of your votes are remembered here.`);
  }

  begin() {
    this.state.voter = at("voter").value.trim();
    store.save(this.state);
    at("start").hidden = true;
    at("tools").hidden = false;
    tell("");
    this.next();
    at("vote").focus();
  }

  next() {
    const done = this.state.votes.length;
    this.progress(done);
    const over = done >= this.order.length;
    at("vote").hidden = over;
    at("end").hidden = !over;
    at("question").hidden = over;
    at("save").classList.toggle("main", over);
    at("skip").hidden = true;
    if (over) {
      this.pair.stop();
      at("thanks").focus();
      return;
    }
    this.from = performance.now();
    this.pair.show(this.order[done]);
    this.label();
  }

  progress(done) {
    const all = this.order.length;
    at("count").textContent = done < all ? `${done + 1} of ${all}` : `${all} of ${all}`;
    at("progress").max = all;
    at("progress").value = done;
    at("undo").setAttribute("aria-disabled", String(done === 0));
    at("save").setAttribute("aria-disabled", String(this.votes.length === 0));
    at("save").textContent = `Save votes (${this.votes.length})`;
  }

  // Buttons keep the focus while they cannot be used.
  label() {
    const { loaded, seen: ready } = this.pair;
    for (const button of this.buttons) button.setAttribute("aria-disabled", String(!ready));
    at("status").textContent = ready ? "Choose, or watch again." : loaded ? "Watch both to the end…" : "Loading…";
  }

  broken() {
    at("status").textContent = "A video of this pair cannot be played.";
    at("skip").hidden = false;
  }

  vote(choice) {
    if (at("vote").hidden || !this.pair.seen) return;
    this.record(choice);
  }

  record(choice) {
    const { left, right } = this.order[this.state.votes.length];
    const seconds = Math.round(performance.now() - this.from) / 1000;
    this.state.votes.push({ left: name(left), right: name(right), choice, seconds });
    store.save(this.state);
    tell("");
    this.next();
  }

  undo() {
    if (!this.state.votes.length) return;
    this.state.votes.pop();
    store.save(this.state);
    this.next();
    tell("Your last choice was taken back.");
  }

  press(event) {
    const { target } = event;
    if (at("tools").hidden || target.closest("input") || event.ctrlKey || event.metaKey || event.altKey) return;
    const stacked = getComputedStyle(at("pair")).gridTemplateColumns.split(" ").length < 2;
    const choice = { ArrowLeft: "left", ArrowRight: "right", ...(stacked && { ArrowUp: "left", ArrowDown: "right" }) }[event.key];
    if (choice) this.vote(choice);
    else if (event.key === " " && !target.closest("button")) this.vote("tie");
    else if (event.key === "Backspace") this.undo();
    else return;
    event.preventDefault();
  }

  save() {
    const { session, voter } = this.state;
    if (!this.votes.length) return;
    const saved = new Date().toISOString().replace(/\.\d+Z$/, "Z");
    const file = { format: test.format, comparison: test.comparison, session, voter, saved, votes: this.votes };
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([JSON.stringify(file, null, 1)], { type: "application/json" }));
    link.download = `votes-${session}.json`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    tell(`Saved as ${link.download}. Send this file to whoever gave you the page.`);
  }
}

// Of a video: its file without folder and ending.
function name(source) {
  return source.replace(/^.*\//, "").replace(/\.mp4$/, "");
}

new Sitting();
