/**
 * Reads what is shown again and again, politely: only what somebody looks at, a few at a time, and ever more rarely
 * while the service is too busy to answer.
 */
import { type Signal, signal } from "@preact/signals";
import { ApiProblem } from "../shared/api";

const AT_ONCE = 3;
/** How often there is a look at what is due. */
const LOOK_MS = 1000;
export const USUAL_S = 10;
const MOST_S = 300;

/** What was last read at an address. */
export interface Reading<T> {
  data: Signal<T | null>;
  /** Why it could not be read the last time. */
  problem: Signal<string | null>;
  /** There is nothing at this address: the service does not offer it. */
  missing: Signal<boolean>;
}

interface Watched extends Reading<unknown> {
  watchers: number;
  everyS: number;
  dueAt: number;
}

type Fetch = (address: string) => Promise<unknown>;

/** All that one page reads. */
export class Reader {
  /** When something was last read, milliseconds. */
  readonly readAt = signal<number | null>(null);
  /** Until when the service is left in peace, milliseconds. */
  readonly restsUntil = signal<number | null>(null);
  readonly paused = signal(false);
  private readonly watched = new Map<string, Watched>();
  private refusals = 0;
  private busy = false;

  constructor(
    private readonly fetch: Fetch,
    private readonly now: () => number = Date.now,
  ) {}

  /** What was read at an address last. */
  at(address: string): Reading<unknown> {
    return this.entry(address);
  }

  /** Begin to read an address every so many seconds; what was read there before is shown at once. */
  watch(address: string, everyS: number): Reading<unknown> {
    const one = this.entry(address);
    one.watchers += 1;
    one.everyS = everyS;
    one.dueAt = Math.min(one.dueAt, this.now() + everyS * 1000);
    return one;
  }

  unwatch(address: string): void {
    const one = this.watched.get(address);
    if (one) one.watchers -= 1;
  }

  /** Everything that is shown is read at once, or what begins with one of these. */
  readNow(...beginnings: string[]): void {
    for (const [address, one] of this.watched)
      if (beginnings.length === 0 || beginnings.some((beginning) => address.startsWith(beginning)))
        one.dueAt = 0;
    if (beginnings.length === 0) this.restsUntil.value = null;
    void this.look(true);
  }

  /** Read what is due. */
  async look(asked = false): Promise<void> {
    const rests = this.restsUntil.value;
    if (this.busy || (this.paused.value && !asked) || (rests !== null && this.now() < rests)) return;
    this.busy = true;
    const due = [...this.watched].filter(
      ([, one]) => one.watchers > 0 && !one.missing.value && one.dueAt <= this.now(),
    );
    let refused = false;
    const next = async (): Promise<void> => {
      for (let entry = due.shift(); entry && !refused; entry = due.shift())
        refused = (await this.read(...entry)) || refused;
    };
    await Promise.all(Array.from({ length: AT_ONCE }, next));
    this.busy = false;
    if (refused) this.refusals += 1;
    else if (this.refusals > 0 && this.restsUntil.value !== null) this.refusals = 0;
    this.restsUntil.value = refused
      ? this.now() + 1000 * Math.min(MOST_S, USUAL_S * 2 ** this.refusals)
      : null;
  }

  /** Look every second while the page is visible, and at once when it becomes visible. */
  start(): void {
    const look = () => {
      if (document.visibilityState === "visible") void this.look();
    };
    setInterval(look, LOOK_MS);
    document.addEventListener("visibilitychange", look);
    look();
  }

  private entry(address: string): Watched {
    let one = this.watched.get(address);
    if (!one) {
      one = {
        data: signal<unknown>(null),
        problem: signal<string | null>(null),
        missing: signal(false),
        watchers: 0,
        everyS: USUAL_S,
        dueAt: 0,
      };
      this.watched.set(address, one);
    }
    return one;
  }

  /** Whether the service refused to answer just now. */
  private async read(address: string, one: Watched): Promise<boolean> {
    try {
      one.data.value = await this.fetch(address);
      one.problem.value = null;
      this.readAt.value = this.now();
    } catch (error) {
      const status = error instanceof ApiProblem ? error.status : null;
      if (status === 404) one.missing.value = true;
      else one.problem.value = error instanceof Error ? error.message : String(error);
      if (status === 503 || status === 429 || status === 0) return true;
    }
    one.dueAt = this.now() + one.everyS * 1000;
    return false;
  }
}
