// The time of a run: played, put somewhere by hand, and told to everything that moves with it.

class Player {
  constructor(told) {
    this.told = told;
    this.bar = document.getElementById("player");
    this.button = document.getElementById("play");
    this.range = document.getElementById("instant");
    this.clock = document.getElementById("clock");
    this.speed = document.getElementById("speed");
    this.share = 0;
    this.playing = false;
    this.button.addEventListener("click", () => this.play(!this.playing));
    this.range.addEventListener("input", () => { this.play(false); this.put(Number(this.range.value) / 1000); });
  }

  // `words(share)` tells the time at a share of the run; a run that goes round begins anew at its end.
  load(words, round) {
    this.words = words;
    this.round = round;
    this.bar.hidden = !words;
    if (!words) this.play(false);
    this.put(Math.min(1, this.share));
  }

  play(on) {
    if (on === this.playing || !this.words) return;
    this.playing = on;
    this.button.textContent = on ? "⏸" : "▶";
    this.button.setAttribute("aria-label", on ? "pause" : "play");
    if (on && this.share >= 1) this.share = 0;
    this.last = null;
    if (on) requestAnimationFrame((now) => this.step(now));
  }

  step(now) {
    if (!this.playing) return;
    const seconds = Number(this.speed.value) / (this.round ? 4 : 1);
    let share = this.share + (this.last === null ? 0 : (now - this.last) / 1000 / seconds);
    this.last = now;
    if (share >= 1) { share = this.round ? share % 1 : 1; if (!this.round) this.play(false); }
    this.put(share);
    if (this.playing) requestAnimationFrame((then) => this.step(then));
  }

  put(share) {
    this.share = Math.min(1, Math.max(0, share));
    this.range.value = String(Math.round(this.share * 1000));
    if (!this.words) return;
    this.clock.textContent = this.words(this.share);
    this.range.setAttribute("aria-valuetext", this.clock.textContent);
    this.told(this.share);
  }
}
