/** What is being asked for: not there yet, there, or why not. */
import { useEffect, useState } from "preact/hooks";
import { errorText } from "../shared/Messages";

export type Loaded<T> = { state: "asking" } | { state: "there"; value: T } | { state: "failed"; why: string };

/** Ask once the component is there; whoever goes asks no longer. */
export function useLoaded<T>(ask: (signal: AbortSignal) => Promise<T>, key: unknown): Loaded<T> {
  const [loaded, set] = useState<Loaded<T>>({ state: "asking" });
  useEffect(() => {
    const ended = new AbortController();
    set({ state: "asking" });
    ask(ended.signal).then(
      (value) => set({ state: "there", value }),
      (error) => {
        if (!ended.signal.aborted) set({ state: "failed", why: errorText(error) });
      },
    );
    return () => ended.abort();
  }, [key]);
  return loaded;
}
