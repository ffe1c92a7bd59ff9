/** Text of the API's description: paragraphs, and names between backquotes. Never markup. */

/** One line of such text. */
export function Words({ text }: { text: string }) {
  const parts = text.split("`");
  if (parts.length % 2 === 0) return <>{text}</>;
  return <>{parts.map((part, n) => (n % 2 ? <code key={n}>{part}</code> : part))}</>;
}

/** Its paragraphs. The API speaks English, whatever the page does. */
export function Prose({ text }: { text: string | undefined }) {
  if (!text) return null;
  return (
    <div lang="en" class="prose">
      {text.split(/\n\s*\n/).map((paragraph) => (
        <p key={paragraph}>
          <Words text={paragraph} />
        </p>
      ))}
    </div>
  );
}
