/** The caller's keys, and for operators the owners; what is made or changed here comes into the lists without another question. */
import { signal } from "@preact/signals";
import type { components, paths } from "../api/schema";
import { api, got } from "../shared/api";
import { may, session, toLogin } from "../shared/session";

export type Key = components["schemas"]["Key"];
export type Owner = components["schemas"]["Owner"];
export type NewKey = paths["/v1/keys"]["post"]["requestBody"]["content"]["application/json"];
/** A secret that has just been made: the service tells it once. */
export interface Told {
  label: string;
  secret: string;
}

export const keys = signal<Key[] | null>(null);
export const owners = signal<Owner[] | null>(null);
export const problem = signal<unknown>(null);
export const told = signal<Told | null>(null);

export type KeyState = "active" | "expired" | "revoked";

/** Whether a key opens anything at a moment. */
export function stateOf(key: Pick<Key, "expires_at" | "revoked_at">, nowMs: number): KeyState {
  if (key.revoked_at !== null) return "revoked";
  return key.expires_at !== null && Date.parse(key.expires_at) <= nowMs ? "expired" : "active";
}

/** Those that open something first, each kind as the service lists it. */
export function inOrder(all: readonly Key[], nowMs: number): Key[] {
  const of = (state: KeyState) => all.filter((key) => stateOf(key, nowMs) === state);
  return [...of("active"), ...of("expired"), ...of("revoked")];
}

/** Whether the visitor logged in with it. */
export const isOwn = (key: Key) => session()?.key?.id === key.id;

export async function load(): Promise<void> {
  problem.value = null;
  try {
    const asked = [got(api.GET("/v1/keys")), may("operate") ? got(api.GET("/v1/owners")) : null] as const;
    const [listed, known] = await Promise.all(asked);
    keys.value = listed.keys;
    owners.value = known?.owners ?? null;
  } catch (error) {
    problem.value = error;
  }
}

function put(changed: Key): void {
  const all = keys.value ?? [];
  const there = all.some((key) => key.id === changed.id);
  keys.value = there ? all.map((key) => (key.id === changed.id ? changed : key)) : [changed, ...all];
}

function countKeys(owner: string, more: 1 | -1): void {
  owners.value =
    owners.value?.map((one) => (one.name === owner ? { ...one, keys: one.keys + more } : one)) ?? null;
}

export async function makeKey(body: NewKey): Promise<void> {
  const made = await got(api.POST("/v1/keys", { body }));
  put(made.key);
  countKeys(made.key.owner.name, 1);
  told.value = { label: made.key.label, secret: made.secret };
}

/** A new secret for the same key: shown before anything else is asked, whatever becomes of this session. */
export async function rotateKey(key: Key): Promise<void> {
  const params = { path: { key_id: key.id } };
  const made = await got(api.POST("/v1/keys/{key_id}/rotate", { params }));
  put(made.key);
  told.value = { label: made.key.label, secret: made.secret };
}

/** A session ends with its key. */
export async function revokeKey(key: Key): Promise<void> {
  await got(api.DELETE("/v1/keys/{key_id}", { params: { path: { key_id: key.id } } }));
  if (isOwn(key)) toLogin();
  put({ ...key, revoked_at: new Date().toISOString() });
  countKeys(key.owner.name, -1);
}

export async function makeOwner(name: string): Promise<void> {
  const owner = await got(api.POST("/v1/owners", { body: { name } }));
  owners.value = [...(owners.value ?? []), owner];
}
