/**
 * Who the service takes this browser for. Asked once for each page, before it is shown (Page.tsx), so that a page can ask
 * `may("own")` wherever it needs to.
 */
import type { components } from "../api/schema";
import { config } from "./config";

export type Session = components["schemas"]["SessionDocument"];
export type Scope = components["schemas"]["Key"]["scope"];

const ADDRESS = "/v1/session";
const LOGIN = "/login";
const SCOPES: readonly Scope[] = ["live", "upload", "own", "operate"];
/** A page does not wait longer for it. */
const PATIENCE_MS = 3000;

let known: Session | null = null;

/** What was answered; null: nothing yet, or nothing that could be read. */
export function session(): Session | null {
  return known;
}

/** Ask. A service that cannot say who this is leaves what was known: whatever else is asked says more. */
export async function askSession(): Promise<void> {
  try {
    const response = await fetch(ADDRESS, { signal: AbortSignal.timeout(PATIENCE_MS) });
    if (response.ok) known = (await response.json()) as Session;
  } catch {
    // no answer, or none in time
  }
}

/** Whether keys are asked for, and this browser has shown none. */
export function isNobody(): boolean {
  return known !== null && known.access === "keys" && known.scope === null;
}

/** Whether the caller has that scope or a larger one. What is not known is tried: the service decides. */
export function may(scope: Scope): boolean {
  if (known === null || known.access === "open") return true;
  return known.scope !== null && SCOPES.indexOf(known.scope) >= SCOPES.indexOf(scope);
}

/**
 * Where one logs in, and comes back from to what is open now, the address's end included. A login in front of the
 * service goes before the service's own; null: there is none.
 */
export function loginAddress(): string | null {
  if (config.login_url !== null) {
    const login = new URL(config.login_url, location.href);
    login.searchParams.set("return_to", location.href);
    return login.href;
  }
  if (known?.access !== "keys") return null;
  const here = location.pathname + location.search + location.hash;
  return `${LOGIN}?${new URLSearchParams({ return_to: here })}`;
}

/** The one place that an answer 401 leads to. */
export function toLogin(): void {
  const address = loginAddress();
  if (address !== null) location.assign(address);
}

let looking: Promise<void> | null = null;

/** Something failed that tells no status, such as a stream of events: whose session is over goes to log in again. */
export async function lookAgain(): Promise<void> {
  if (known === null || isNobody()) return;
  looking ??= askSession();
  await looking;
  looking = null;
  if (isNobody()) toLogin();
}

/** Whether what a map could not load leads to log in: tiles tell their status, parts of a kept map do not. */
export function ledToLogin(error: unknown): boolean {
  if ((error as { status?: number }).status === 401 && loginAddress() !== null) {
    toLogin();
    return true;
  }
  void lookAgain();
  return false;
}
