/** Asks before anything is destroyed, and says what would be: `if (await confirmed({ ... })) ...`. */
import { type ComponentChildren, render } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { t } from "./texts";

interface Question {
  title: string;
  /** What will happen, with figures. */
  what: ComponentChildren;
  /** The verb on the button. */
  action: string;
  /** Whether something is lost by it. */
  destructive?: boolean;
}

function Ask({ question, answer }: { question: Question; answer: (yes: boolean) => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => dialog.current?.showModal(), []);
  return (
    <dialog
      ref={dialog}
      aria-labelledby="question"
      onClose={() => answer(dialog.current?.returnValue === "yes")}
    >
      <form method="dialog">
        <h2 id="question">{question.title}</h2>
        <div>{question.what}</div>
        <div class="buttons">
          <button type="submit" value="no">
            {t("page.cancel")}
          </button>
          <button type="submit" value="yes" class={question.destructive ? "danger" : "primary"}>
            {question.action}
          </button>
        </div>
      </form>
    </dialog>
  );
}

/** Whether the visitor agrees; Escape is no. */
export function confirmed(question: Question): Promise<boolean> {
  const place = document.body.appendChild(document.createElement("div"));
  return new Promise((resolve) => {
    const answer = (yes: boolean) => {
      render(null, place);
      place.remove();
      resolve(yes);
    };
    render(<Ask question={question} answer={answer} />, place);
  });
}
