/** What is kept of a recording as it comes, a chunk every few seconds. Knows no database: a shelf is given. */
import type { Totals } from "./figures";
import { FIX_COLUMNS, type Fix, MOTION_COLUMNS, type Motion } from "./samples";

/** A recording as the shelf lists it. */
export interface Recording {
  id: string;
  began_ms: number;
  /** What the device's altitudes are above. */
  altitudes: "ellipsoid" | "sea level";
  /** Whether it was offered to the service: then nothing comes to it any more, so that the same bytes go again. */
  sealed: boolean;
  chunks: number;
  totals: Totals;
}

/** Rows one after the other, as `FIX_COLUMNS` and `MOTION_COLUMNS` name their numbers. */
export interface Chunk {
  fixes: Float64Array;
  motions: Float64Array;
}

/** Where recordings stand until they are sent. */
export interface Shelf {
  all(): Promise<Recording[]>;
  /** The recording as it is now, and a further chunk of it: both, or neither. */
  put(recording: Recording, chunk?: Chunk): Promise<void>;
  /** In their order. */
  chunks(id: string): Promise<Chunk[]>;
  remove(id: string): Promise<void>;
}

/** Keeps one recording: what could not be kept stays in memory, and is tried again with what comes next. */
export class Keeper {
  private fixes: number[] = [];
  private motions: number[] = [];
  private working: Promise<void> = Promise.resolve();

  constructor(
    private readonly shelf: Shelf,
    public recording: Recording,
  ) {}

  addFix(fix: Fix): void {
    for (const column of FIX_COLUMNS) this.fixes.push(fix[column]);
  }

  addMotion(motion: Motion): void {
    for (const column of MOTION_COLUMNS) this.motions.push(motion[column]);
  }

  /** Keep what has come, with the totals as they are; one after the other. The promise fails where the shelf does. */
  keep(totals: Totals): Promise<void> {
    const done = this.working.then(() => this.write(totals));
    this.working = done.catch(() => undefined);
    return done;
  }

  private async write(totals: Totals): Promise<void> {
    const chunk = { fixes: Float64Array.from(this.fixes), motions: Float64Array.from(this.motions) };
    const bytes = chunk.fixes.byteLength + chunk.motions.byteLength;
    const { chunks, totals: before } = this.recording;
    // Who has got nothing at all has recorded nothing.
    if (bytes === 0 && chunks === 0) return;
    const kept: Recording = {
      ...this.recording,
      chunks: chunks + (bytes > 0 ? 1 : 0),
      totals: {
        ...totals,
        bytes: before.bytes + bytes,
        motions: before.motions + chunk.motions.length / MOTION_COLUMNS.length,
      },
    };
    await this.shelf.put(kept, bytes > 0 ? chunk : undefined);
    this.recording = kept;
    this.fixes.splice(0, chunk.fixes.length);
    this.motions.splice(0, chunk.motions.length);
  }
}
