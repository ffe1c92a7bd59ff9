/** Other tabs of this browser: what one of them changed at the service is asked for anew in the others. */
const SOON_MS = 300;

let opened: BroadcastChannel | null = null;

function channel(): BroadcastChannel {
  opened ??= new BroadcastChannel("versant");
  return opened;
}

/** Something of the service was changed from here. */
export function tellTabs(): void {
  channel().postMessage("changed");
}

/** `look` is called soon after another tab changed something, once for several changes. */
export function whenTold(look: () => void): void {
  let waits = false;
  channel().addEventListener("message", () => {
    if (waits) return;
    waits = true;
    setTimeout(() => {
      waits = false;
      look();
    }, SOON_MS);
  });
}
