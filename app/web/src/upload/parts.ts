/**
 * A large file in parts (tus 1.0.0). Where the connection breaks it goes on from what has come, as soon as there is one
 * again, and so it does where the same file is chosen again in this tab, after a reload of the page too.
 */
import { asked, Refusal } from "./request";

/** Less is sent again sooner than it is asked where it stands. */
export const IN_PARTS_BYTES = 16 << 20;
const PART_BYTES = 8 << 20;
const TUS = { "Tus-Resumable": "1.0.0" };
/** After so many seconds it is tried again, from the sixth time on after the last; and how often in a row. */
const WAITS_S = [1, 2, 5, 10, 20, 30];
const TRIES = 15;
/** No answer, none of that name, not from there on: it goes on once it is known how far it is. */
const GO_ON = [0, 404, 409];
/** None of that name, or wrong for good; after any other answer the same upload goes on when it is tried again. */
const FORGOTTEN = [400, 404, 413, 415, 422];
/** An owner has so many under way, in tabs that were closed too, or one came in too many parts. */
export const TOO_MANY = "/problems/too-many";
const KEPT = "versant:parts";

interface Way {
  sent: (bytes: number) => void;
  lost: (is: boolean) => void;
}

/** Send it. What the service makes of it, as text; fails with a `Refusal`. */
export async function inParts(
  file: File,
  query: URLSearchParams,
  way: Way,
  signal: AbortSignal,
): Promise<string> {
  const upload = new InParts(file, query, way, signal);
  for (let failed = 0; ; ) {
    const before = upload.offset;
    try {
      if (await upload.step()) return await upload.end();
      way.lost(false);
    } catch (error) {
      const again = upload.isToGoOn(error);
      failed = upload.offset > before ? 1 : failed + 1;
      if (!again || failed > TRIES) throw error;
      way.lost(true);
      await connected(WAITS_S[Math.min(failed, WAITS_S.length) - 1] ?? 0, signal);
    }
  }
}

class InParts {
  /** How far it is as far as that is known. */
  offset = 0;
  private place: string | null;
  private known = false;
  private readonly key: string;

  constructor(
    private readonly file: File,
    private readonly query: URLSearchParams,
    private readonly way: Way,
    private readonly signal: AbortSignal,
  ) {
    this.key = [file.name, file.size, file.lastModified, query].join("|");
    this.place = kept()[this.key] ?? null;
  }

  /** Begin it, or ask how far it is, or send the next part; whether something came of all of them. */
  async step(): Promise<boolean> {
    if (this.place === null) {
      await this.begin();
      return false;
    }
    const { signal, file } = this;
    if (!this.known) return this.took(await asked("HEAD", this.place, { headers: TUS, signal }));
    const at = this.offset;
    this.known = false;
    const headers = {
      ...TUS,
      "Content-Type": "application/offset+octet-stream",
      "Upload-Offset": String(at),
    };
    const sent = (bytes: number) => this.way.sent(at + bytes);
    const body = file.slice(at, at + PART_BYTES);
    return this.took(await asked("PATCH", this.place, { headers, body, signal, sent }));
  }

  /** What came of it. */
  async end(): Promise<string> {
    const answer = await asked("GET", this.place ?? "", { signal: this.signal });
    keep(this.key, null);
    return answer.responseText;
  }

  /** Whether another try is worth it by itself; where none ever is, what has come is forgotten. */
  isToGoOn(error: unknown): boolean {
    const { status, type } = error instanceof Refusal ? error.problem : { status: null, type: null };
    const { aborted } = this.signal;
    if (aborted && this.place !== null) void fetch(this.place, { method: "DELETE", headers: TUS });
    if (aborted || type === TOO_MANY || FORGOTTEN.includes(status ?? 0)) {
      keep(this.key, null);
      this.place = null;
    }
    return !aborted && type !== TOO_MANY && GO_ON.includes(status ?? -1);
  }

  private async begin(): Promise<void> {
    const name = btoa(String.fromCharCode(...new TextEncoder().encode(this.file.name)));
    const headers = {
      ...TUS,
      "Upload-Length": String(this.file.size),
      "Upload-Metadata": `filename ${name}`,
    };
    const answer = await asked("POST", `/v1/uploads?${this.query}`, { headers, signal: this.signal });
    this.place = new URL(answer.getResponseHeader("Location") ?? "", location.href).pathname;
    this.offset = 0;
    this.known = true;
    keep(this.key, this.place);
  }

  private took(answer: XMLHttpRequest): boolean {
    this.offset = Number(answer.getResponseHeader("Upload-Offset"));
    this.known = true;
    this.way.sent(this.offset);
    return answer.getResponseHeader("Content-Location") !== null;
  }
}

/** Wait so long, or until the browser says that there is a connection again. */
function connected(seconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const over = new AbortController();
    const end = () => {
      clearTimeout(timer);
      over.abort();
      resolve();
    };
    const timer = setTimeout(end, seconds * 1000);
    addEventListener("online", end, { signal: over.signal });
    signal.addEventListener("abort", end, { signal: over.signal });
  });
}

function kept(): Record<string, string> {
  return JSON.parse(sessionStorage.getItem(KEPT) ?? "{}") as Record<string, string>;
}

function keep(key: string, place: string | null): void {
  const { [key]: _, ...others } = kept();
  sessionStorage.setItem(KEPT, JSON.stringify(place === null ? others : { ...others, [key]: place }));
}
