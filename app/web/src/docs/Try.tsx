/** Ask the service for something, here and now: for what only reads. */
import { useEffect, useRef, useState } from "preact/hooks";
import { problemOf } from "../shared/api";
import { number, size } from "../shared/format";
import { errorText } from "../shared/Messages";
import { t } from "../shared/texts";
import { type ApiDocument, addressOf, meaningOf, type Operation, type Parameter, sampleOf } from "./openapi";

const MOST_SHOWN = 20_000;
const READABLE = /^text\/|json|xml/;

interface Got {
  address: string;
  status: number;
  type: string;
  bytes: number;
  took_ms: number;
  text: string | null;
  cut: boolean;
  picture: string | null;
}

/** The beginning of an answer's text: a stream of events may never end. */
async function beginning(response: Response): Promise<{ text: string; bytes: number; cut: boolean }> {
  const reader = response.body?.getReader();
  const decoder = new TextDecoder();
  let text = "";
  let bytes = 0;
  while (reader) {
    const { done, value } = await reader.read();
    if (done) return { text, bytes, cut: false };
    bytes += value.length;
    text += decoder.decode(value, { stream: true });
    const stream = response.headers.get("content-type")?.startsWith("text/event-stream");
    if (text.length > MOST_SHOWN || (stream && text.includes("\n\n"))) {
      await reader.cancel();
      return { text: text.slice(0, MOST_SHOWN), bytes, cut: true };
    }
  }
  return { text, bytes, cut: false };
}

function pretty(text: string, type: string, cut: boolean): string {
  if (cut || !type.includes("json")) return text;
  try {
    return JSON.stringify(JSON.parse(text), null, 2);
  } catch {
    return text;
  }
}

async function ask(address: string, accept: string | null, signal: AbortSignal): Promise<Got> {
  const started = performance.now();
  const response = await fetch(address, { signal, headers: accept ? { Accept: accept } : {} });
  if (response.status === 401) throw await problemOf(response);
  const type = response.headers.get("content-type") ?? "";
  const told = { address, status: response.status, type, took_ms: performance.now() - started };
  if (READABLE.test(type)) {
    const { text, bytes, cut } = await beginning(response);
    return { ...told, bytes, text: pretty(text, type, cut), cut, picture: null };
  }
  const blob = await response.blob();
  const picture = type.startsWith("image/") ? URL.createObjectURL(blob) : null;
  return { ...told, bytes: blob.size, text: null, cut: false, picture };
}

function Result({ got }: { got: Got }) {
  return (
    <>
      <p>
        <strong>{got.status}</strong> {got.type} {size(got.bytes)}, {number(got.took_ms)} ms{" "}
        <a href={got.address}>{t("docs.open")}</a>
      </p>
      {got.picture && <img class="answer" src={got.picture} alt={t("docs.picture")} />}
      {got.text && (
        // biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls must be reached by keyboard
        <pre class="answer" tabIndex={0}>
          <code>{got.text.length > MOST_SHOWN ? got.text.slice(0, MOST_SHOWN) : got.text}</code>
        </pre>
      )}
      {(got.cut || (got.text?.length ?? 0) > MOST_SHOWN) && <p class="quiet-text">{t("docs.cut")}</p>}
    </>
  );
}

interface FieldProps {
  id: string;
  parameter: Parameter;
  document: ApiDocument;
  value: string;
  onValue: (value: string) => void;
}

function Field({ id, parameter, document, value, onValue }: FieldProps) {
  const { schema } = meaningOf(parameter.schema ?? {}, document);
  const choices = schema.enum ?? (schema.type === "boolean" ? [true, false] : null);
  const needed = parameter.required ?? false;
  return (
    <label for={id}>
      <span>
        {parameter.name}
        {needed && ` (${t("docs.required")})`}
      </span>
      {choices ? (
        <select id={id} value={value} onChange={(event) => onValue(event.currentTarget.value)}>
          {!needed && <option value="">{t("docs.unset")}</option>}
          {choices.map((one) => (
            <option key={String(one)}>{String(one)}</option>
          ))}
        </select>
      ) : (
        <input
          id={id}
          value={value}
          required={needed}
          placeholder={sampleOf(parameter, document)}
          onInput={(event) => onValue(event.currentTarget.value)}
        />
      )}
    </label>
  );
}

/** Fields for the parameters, a button, and what was answered. */
export function Try({ operation, document }: { operation: Operation; document: ApiDocument }) {
  const parameters = (operation.parameters ?? []).filter((one) => one.in === "path" || one.in === "query");
  const [values, setValues] = useState<Record<string, string>>({});
  const [got, setGot] = useState<Got | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  const running = useRef<AbortController | null>(null);
  const [busy, setBusy] = useState(false);
  useEffect(() => () => running.current?.abort(), []);
  useEffect(() => () => void (got?.picture && URL.revokeObjectURL(got.picture)), [got]);
  const accept = Object.keys(operation.responses["200"]?.content ?? {})[0] ?? null;

  const send = async (event: Event) => {
    event.preventDefault();
    running.current?.abort();
    const mine = new AbortController();
    running.current = mine;
    setBusy(true);
    setProblem(null);
    try {
      setGot(await ask(addressOf(operation, values), accept, mine.signal));
    } catch (error) {
      if (!mine.signal.aborted) {
        setGot(null);
        setProblem(error instanceof TypeError ? t("problem.offline") : errorText(error));
      }
    }
    if (running.current === mine) setBusy(false);
  };

  return (
    <form class="try" onSubmit={send} aria-label={t("docs.try", { what: operation.path })}>
      <div class="fields">
        {parameters.map((one) => (
          <Field
            key={one.name}
            id={`${operation.id}.${one.name}`}
            parameter={one}
            document={document}
            value={values[one.name] ?? ""}
            onValue={(value) => setValues({ ...values, [one.name]: value })}
          />
        ))}
      </div>
      <p class="send">
        <button type="submit" class="primary">
          {t("docs.send")}
        </button>
        {busy && (
          <button type="button" onClick={() => running.current?.abort()}>
            {t("docs.stop")}
          </button>
        )}
      </p>
      <div role="status" aria-busy={busy}>
        {problem && <p class="error-text">{problem}</p>}
        {got && <Result got={got} />}
      </div>
    </form>
  );
}
