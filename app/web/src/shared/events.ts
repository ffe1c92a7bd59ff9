/** Server-sent events of one address: comes again by itself, and says when it is over. */

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
    // The browser connects again unless the answer was no stream: too many of them, or the drive is gone.
    if (source.readyState === EventSource.CLOSED) ended?.();
  });
  return () => source.close();
}
