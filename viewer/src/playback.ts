/** Plays a motion in time: what instant is shown, and when the next one is due. Knows no page. */

import type { Motion, Poses } from "./drawing.js";
import { durationOf, posesAt } from "./motion.js";

/** Simulated seconds in a second of wall time. */
export const SPEEDS = [1 / 64, 1 / 16, 1 / 4, 1, 4, 16] as const;
const LONGEST_S = 8;
const SHORTEST_S = 1;

/** The speed nearest to real time at which a duration [s] takes neither too long nor a blink. */
export function usualSpeed(duration: number): number {
  const fits = SPEEDS.filter((speed) => duration / speed <= LONGEST_S && duration / speed >= SHORTEST_S);
  const real = (speed: number) => Math.abs(Math.log(speed));
  const [best] = fits.sort((one, other) => real(one) - real(other));
  return best ?? (duration > LONGEST_S ? SPEEDS[SPEEDS.length - 1]! : SPEEDS[0]);
}

export class Playback {
  speed: number;
  /** The instant that is shown [s]. */
  time: number;
  private frame = 0;
  private last = 0;

  /**
   * @param motion - What is played.
   * @param still - The poses of all bodies at its end.
   * @param onChange - Receives the poses whenever another instant is shown, or it starts or stops.
   */
  constructor(
    readonly motion: Motion,
    private readonly still: Poses,
    private readonly onChange: (poses: Poses, playback: Playback) => void,
  ) {
    this.speed = usualSpeed(durationOf(motion));
    this.time = this.end;
  }

  get start(): number {
    return this.motion.times[0] ?? 0;
  }

  get end(): number {
    return this.motion.times.at(-1) ?? 0;
  }

  get playing(): boolean {
    return this.frame !== 0;
  }

  /** Go on from the instant that is shown; from the start if that is the end. */
  play(): void {
    if (this.playing) return;
    if (this.time >= this.end) this.time = this.start;
    this.last = performance.now();
    this.frame = requestAnimationFrame((now) => this.tick(now));
    this.tell();
  }

  pause(): void {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.tell();
  }

  toggle(): void {
    if (this.playing) this.pause();
    else this.play();
  }

  /** Show an instant [s]. */
  seek(time: number): void {
    this.time = Math.min(Math.max(time, this.start), this.end);
    this.tell();
  }

  private tick(now: number): void {
    this.time = Math.min(this.time + (Math.max(0, now - this.last) / 1000) * this.speed, this.end);
    this.last = now;
    this.frame = this.time < this.end ? requestAnimationFrame((next) => this.tick(next)) : 0;
    this.tell();
  }

  private tell(): void {
    this.onChange(posesAt(this.motion, this.still, this.time), this);
  }
}
