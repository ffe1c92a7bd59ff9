/** Server-sent events of one address: comes again by itself, and says when it is over. */
import { lookAgain } from "./session";

/** Follow `address`; `told` gets each event of that name. Returns what ends it. */
export function follow<T>(
  address: string,
  name: string,
  onData: (data: T) => void,
  ended?: () => void,
): () => void {
  const source = new EventSource(address);
  source.addEventListener(name, (event) => onData(JSON.parse((event as MessageEvent<string>).data) as T));
  source.addEventListener("error", () => {
    // The browser connects again unless the answer was no stream: too many of them, the drive or the session is gone.
    if (source.readyState !== EventSource.CLOSED) return;
    void lookAgain();
    ended?.();
  });
  return () => source.close();
}
