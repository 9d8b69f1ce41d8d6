/**
 * A film as `physment-eval film` writes it, and what it shows at each of its instants. Knows no page.
 * `evaluator/films/motion.py` writes the numbers: second differences, zigzag, base 128; a 0 is followed by how many more.
 */

import type { Drawing, Pose, Poses, Readings, Triple } from "./drawing.js";
import { between } from "./motion.js";

export interface Film {
  format: 1;
  /** SHA-256 of the record that it shows. */
  episode: string;
  /** Whether it also shows what the agent could not see. */
  revealed?: boolean;
  /** For each call of each turn, the instant at which it had returned. */
  calls: number[][];
  /** From which call on, counted over all turns, what was read last of objects that are not drawn. */
  read?: [number, Readings][];
  drawings: Drawing[];
  /** From which instant on which drawing is shown. */
  cuts: [number, number][];
  bodies: string[];
  /** Number of instants. */
  count: number;
  /** Step of positions [m] and of quaternions. */
  step: number;
  turn: number;
  /** Times [µs], then the seven numbers of each body, in steps; as base64. */
  data: string;
}

export class Reel {
  /** Simulated time at each instant [s]; several instants may share it. */
  readonly times: number[];
  private readonly courses: number[][][];

  constructor(readonly film: Film) {
    const numbers = new Numbers(film.data);
    this.times = numbers.course(film.count).map((micro) => micro / 1e6);
    this.courses = film.bodies.map(() =>
      Array.from({ length: 7 }, (_, axis) => {
        const unit = axis < 3 ? film.step : film.turn;
        return numbers.course(film.count).map((value) => value * unit);
      }),
    );
  }

  /** Last instant. */
  get end(): number {
    return this.film.count - 1;
  }

  /** The drawing at a position, which is an instant and a share of the way to the next. */
  drawing(position: number): Drawing {
    const past = this.film.cuts.filter(([instant]) => instant <= position);
    return this.film.drawings[past.at(-1)?.[1] ?? 0] ?? { bodies: [] };
  }

  /** Where all bodies are at a position. */
  poses(position: number): Poses {
    const first = Math.floor(position);
    const share = position - first;
    const found: Poses = {};
    this.film.bodies.forEach((name, body) => {
      const pose = this.pose(body, first);
      found[name] = share > 0 && this.lasts(first) ? between(pose, this.pose(body, first + 1), share) : pose;
    });
    return found;
  }

  /** The simulated time at a position [s]. */
  time(position: number): number {
    const first = Math.floor(position);
    const from = this.times[first] ?? 0;
    return from + ((this.times[first + 1] ?? from) - from) * (position - first);
  }

  /** The position at a simulated time [s]; of several instants that share it, the last. */
  position(time: number): number {
    let low = 0;
    let high = this.end;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.times[middle]! <= time) low = middle;
      else high = middle - 1;
    }
    if (low === this.end || !this.lasts(low)) return low;
    return low + (time - this.times[low]!) / (this.times[low + 1]! - this.times[low]!);
  }

  /** All things that are ever seen, for the camera. */
  everything(): Drawing {
    const bodies = new Map(this.film.drawings.flatMap((drawing) => drawing.bodies.map((body) => [body.id, body])));
    const schematic = this.film.drawings.flatMap((drawing) => drawing.schematic ?? []);
    const names = Object.assign({}, ...this.film.drawings.map((drawing) => drawing.names)) as Record<string, string>;
    return { bodies: [...bodies.values()], schematic, names };
  }

  /** What was read last once so many calls had returned. */
  read(calls: number): Readings {
    return (this.film.read ?? []).filter(([call]) => call < calls).at(-1)?.[1] ?? {};
  }

  /** All places that are ever read, for the camera. */
  places(): Triple[] {
    return (this.film.read ?? []).flatMap(([, read]) => Object.values(read).map((reading) => reading.position));
  }

  private pose(body: number, instant: number): Pose {
    const [x, y, z, ...turn] = this.courses[body]!.map((course) => course[instant]!);
    const length = Math.hypot(...turn) || 1;
    return [x, y, z, ...turn.map((value) => value / length)] as Pose;
  }

  /** Whether time passes between an instant and the next. */
  private lasts(instant: number): boolean {
    return (this.times[instant + 1] ?? 0) > this.times[instant]!;
  }
}

class Numbers {
  private readonly bytes: Uint8Array;
  private at = 0;

  constructor(base64: string) {
    this.bytes = Uint8Array.from(atob(base64), (sign) => sign.charCodeAt(0));
  }

  /** The next sequence of so many whole numbers. */
  course(count: number): number[] {
    const values: number[] = [];
    let [before, last, zeros] = [0, 0, 0];
    for (let place = 0; place < count; place += 1) {
      let difference = 0;
      if (zeros > 0) zeros -= 1;
      else {
        const written = this.base128();
        if (written === 0) zeros = this.base128();
        else difference = written % 2 === 0 ? written / 2 : -(written + 1) / 2;
      }
      const value = difference + (place > 1 ? 2 * last - before : last);
      [before, last] = [last, value];
      values.push(value);
    }
    return values;
  }

  private base128(): number {
    let [value, factor] = [0, 1];
    for (;;) {
      const byte = this.bytes[this.at++];
      if (byte === undefined) throw new RangeError("the film ends too early");
      value += (byte % 128) * factor;
      if (byte < 128) return value;
      factor *= 128;
    }
  }
}
