/** Programs that send points, the address that was just made, and the devices that send, asked for again and again. */
import { signal } from "@preact/signals";
import type { components } from "../api/schema";
import { api, got } from "../shared/api";

export type Sender = components["schemas"]["SenderDocument"];
export type Stream = components["schemas"]["Stream"];
export type Made = components["schemas"]["MadeAddress"];

/** A point comes every second or so: who has just typed an address in waits for it. */
export const LOOK_EVERY_MS = 3000;

export const senders = signal<Sender[]>([]);
export const streams = signal<Stream[] | null>(null);
export const problem = signal<unknown>(null);
/** The address that was just made, and for which program: the service tells it once. */
export const made = signal<(Made & { sender: Sender }) | null>(null);

export async function load(): Promise<void> {
  problem.value = null;
  try {
    const [programs, devices] = await Promise.all([
      got(api.GET("/v1/live/senders")),
      got(api.GET("/v1/live")),
    ]);
    senders.value = programs.senders;
    streams.value = devices.streams;
  } catch (error) {
    problem.value = error;
  }
}

/** Ask again; where there is no answer, what was told stays. */
export async function look(): Promise<void> {
  if (document.hidden || streams.value === null) return;
  try {
    streams.value = (await got(api.GET("/v1/live"))).streams;
  } catch {
    // the next look may be answered
  }
}

export async function makeAddress(sender: Sender, label: string): Promise<void> {
  const answer = await got(api.POST("/v1/live/addresses", { body: { sender: sender.name, label } }));
  made.value = { ...answer, sender };
}

export async function revoke(stream: Stream): Promise<void> {
  if (stream.key === null) return;
  await got(api.DELETE("/v1/keys/{key_id}", { params: { path: { key_id: stream.key } } }));
  await look();
}

/** The device that has sent by the address that was just made; undefined: none has. */
export const seenBy = (key: string): Stream | undefined => streams.value?.find((one) => one.key === key);

/** Where a program's steps stand among the texts. */
export const wordOf = (sender: string): string => sender.replaceAll("-", "_");
