/**
 * Follows drives until they are over: the first ones by server-sent events, the others by asking for one at a time.
 *
 * A browser opens six connections to a host, so only two of them are streams; drives are processed about in the order
 * of their uploads, and the next stream begins when one is over. Where the service has no more streams, all are asked.
 */
import { ApiProblem } from "./api";
import { type Drive, getDrive } from "./drives";
import { follow } from "./events";

interface Followed<T> {
  driveOf: (item: T) => string;
  /** Those that are not over, the oldest first. */
  unfinished: () => T[];
  onDrive: (item: T, drive: Drive) => void;
  gone: (item: T) => void;
  /** Those that nothing happens to until somebody does something: no stream is kept open for them. */
  rests?: (item: T) => boolean;
}

const STREAMS = 2;
const ASK_EVERY_MS = 1000;
const ASK_RESTING_MS = 3000;
const WITHOUT_STREAMS_MS = 30_000;

/** Follows the items of one list. */
export class Follower<T> {
  private readonly streams = new Map<T, () => void>();
  private noStreamsUntil = 0;
  private turn = 0;
  private timer: ReturnType<typeof setTimeout> | null = null;

  constructor(private readonly list: Followed<T>) {}

  /** Look whom to follow: to be called when the list has changed. */
  arrange(): void {
    const all = this.list.unfinished();
    const wanted = all.filter((item) => !this.rests(item));
    for (const item of this.streams.keys()) if (!wanted.includes(item)) this.end(item);
    for (const item of wanted) {
      if (this.streams.size >= STREAMS || Date.now() < this.noStreamsUntil) break;
      if (!this.streams.has(item)) this.begin(item);
    }
    if (all.length > 0 && this.timer === null)
      this.timer = setTimeout(() => void this.ask(), wanted.length > 0 ? ASK_EVERY_MS : ASK_RESTING_MS);
  }

  private rests(item: T): boolean {
    return this.list.rests?.(item) ?? false;
  }

  private begin(item: T): void {
    const address = `/v1/drives/${this.list.driveOf(item)}/events`;
    const onDrive = (drive: Drive) => {
      this.list.onDrive(item, drive);
      this.arrange();
    };
    const ended = () => {
      this.end(item);
      this.noStreamsUntil = Date.now() + WITHOUT_STREAMS_MS;
    };
    this.streams.set(item, follow<Drive>(address, "drive", onDrive, ended));
  }

  private end(item: T): void {
    this.streams.get(item)?.();
    this.streams.delete(item);
  }

  private async ask(): Promise<void> {
    const asked = this.list.unfinished().filter((item) => !this.streams.has(item));
    this.turn += 1;
    const item = asked[this.turn % Math.max(asked.length, 1)];
    if (item !== undefined) {
      const rested = this.rests(item);
      await this.askFor(item);
      // What one waited for is there, as a rule for the others, too.
      if (rested && !this.rests(item)) for (const one of asked) if (this.rests(one)) await this.askFor(one);
    }
    this.timer = null;
    this.arrange();
  }

  private async askFor(item: T): Promise<void> {
    try {
      this.list.onDrive(item, await getDrive(this.list.driveOf(item)));
    } catch (error) {
      // What else may be wrong is over in a while, and it is asked again.
      if (error instanceof ApiProblem && error.status === 404) this.list.gone(item);
    }
  }
}
