/** What a form does with what was typed: once at a time, and with the reason where it fails. */
import { useSignal } from "@preact/signals";
import { errorText } from "./Messages";

/**
 * For a form that sends something by `work`, where somebody `agreed` to it: what it does when it is submitted, whether
 * that is under way, and the place where it says why it failed.
 */
export function useSending(work: () => Promise<void>, agreed: () => Promise<boolean> = async () => true) {
  const busy = useSignal(false);
  const why = useSignal<string | null>(null);
  const send = async () => {
    if (!(await agreed())) return;
    busy.value = true;
    why.value = null;
    try {
      await work();
    } catch (error) {
      why.value = errorText(error);
    }
    busy.value = false;
  };
  return {
    busy: busy.value,
    submit: (event: Event) => {
      event.preventDefault();
      void send();
    },
    failure: (
      <p class="error-text" role="alert">
        {why.value}
      </p>
    ),
  };
}
