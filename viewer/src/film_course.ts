/** Which instant of a film is shown, and which call that belongs to. Knows no page. */

import type { Reel } from "./reel.js";

/** Simulated seconds in a second of wall time. */
export const SPEEDS = [1 / 64, 1 / 16, 1 / 4, 1, 4, 16, 64] as const;
const LONGEST_S = 40;
const SHORTEST_S = 3;

/** A call of the film: its turn and its place there, from 0, and the instant at which it had returned. */
export interface CallPlace {
  turn: number;
  call: number;
  instant: number;
}

export class FilmCourse {
  readonly calls: CallPlace[];
  speed: number;
  /** The instant that is shown, and a share of the way to the next. */
  position = 0;
  /** Index of the call that is shown as made; -1 before the first. */
  current = -1;
  private frame = 0;
  private last = 0;

  constructor(
    readonly reel: Reel,
    private readonly onChange: () => void,
  ) {
    this.calls = reel.film.calls.flatMap((instants, turn) =>
      instants.map((instant, call) => ({ turn, call, instant })),
    );
    const duration = this.end - this.start;
    const fits = SPEEDS.filter((speed) => duration / speed <= LONGEST_S && duration / speed >= SHORTEST_S);
    fits.sort((one, other) => Math.abs(Math.log(one)) - Math.abs(Math.log(other)));
    this.speed = fits[0] ?? (duration > LONGEST_S ? 64 : 1 / 64);
  }

  get start(): number {
    return this.reel.times[0] ?? 0;
  }

  get end(): number {
    return this.reel.times.at(-1) ?? 0;
  }

  get time(): number {
    return this.reel.time(this.position);
  }

  get playing(): boolean {
    return this.frame !== 0;
  }

  /** Go on from what is shown; from the start if that is the end. Does nothing in a film without time. */
  play(): void {
    if (this.playing || this.end <= this.start) return;
    if (this.position >= this.reel.end) this.seek(this.start);
    this.last = performance.now();
    this.frame = requestAnimationFrame((now) => this.tick(now));
    this.onChange();
  }

  pause(): void {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.onChange();
  }

  toggle(): void {
    if (this.playing) this.pause();
    else this.play();
  }

  /** Show a simulated time [s]. */
  seek(time: number): void {
    this.position = this.reel.position(Math.min(Math.max(time, this.start), this.end));
    this.current = this.callAt(this.position);
    this.onChange();
  }

  /** Show what was there after a call; before the first one if its index is -1. */
  showCall(index: number): void {
    this.current = Math.min(Math.max(index, -1), this.calls.length - 1);
    this.position = this.calls[this.current]?.instant ?? 0;
    this.onChange();
  }

  /** Show the first call of the turn that is so many turns away. */
  showTurn(away: number): void {
    const turn = (this.calls[this.current]?.turn ?? -1) + away;
    if (turn < 0) this.showCall(-1);
    else this.showCall(this.calls.findIndex((call) => call.turn >= turn));
  }

  /** The call in which time passes at a position; else the last one that has been made. */
  private callAt(position: number): number {
    const next = this.calls.findIndex((call) => call.instant > position);
    const made = (next < 0 ? this.calls.length : next) - 1;
    const returned = this.calls[made]?.instant ?? 0;
    return position > returned ? Math.min(made + 1, this.calls.length - 1) : made;
  }

  private tick(now: number): void {
    const time = this.time + (Math.max(0, now - this.last) / 1000) * this.speed;
    this.last = now;
    this.frame = time < this.end ? requestAnimationFrame((next) => this.tick(next)) : 0;
    this.seek(time);
  }
}
