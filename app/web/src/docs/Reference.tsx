/** What can be asked of the service: one entry per operation, made when it is opened. */
import { useFold } from "../shared/address";
import { tellDone, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import {
  type Answer,
  type ApiDocument,
  curlOf,
  exampleOf,
  type Group,
  type Media,
  type Operation,
  type Parameter,
} from "./openapi";
import { Prose, Words } from "./Prose";
import { Facts, Properties } from "./Schema";
import { Try } from "./Try";

const PLACES = {
  path: "docs.in_path",
  query: "docs.in_query",
  header: "docs.in_header",
  cookie: "docs.in_cookie",
} as const;

function Code({ text, label }: { text: string; label: string }) {
  const copy = () => navigator.clipboard.writeText(text).then(() => tellDone(t("docs.copied")), tellError);
  return (
    <div class="code">
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls must be reached by keyboard */}
      <pre tabIndex={0}>
        <code>{text}</code>
      </pre>
      <button type="button" class="quiet" onClick={copy} aria-label={label}>
        {t("docs.copy")}
      </button>
    </div>
  );
}

function Parameters({ parameters, document }: { parameters: Parameter[]; document: ApiDocument }) {
  return (
    <>
      <h4>{t("docs.parameters")}</h4>
      <ul class="properties">
        {parameters.map((one) => (
          <li key={`${one.in} ${one.name}`}>
            <code class="name">{one.name}</code> <span class="quiet-text">{t(PLACES[one.in])}</span>{" "}
            {one.required && <strong>{t("docs.required")}</strong>}{" "}
            {one.schema && <Facts schema={one.schema} document={document} sent />}
            <Prose text={one.description} />
          </li>
        ))}
      </ul>
    </>
  );
}

function Contents({
  content,
  document,
  what,
}: {
  content: Record<string, Media>;
  document: ApiDocument;
  what: string;
}) {
  return (
    <>
      {Object.entries(content).map(([type, media]) => {
        const example = media.example ?? exampleOf(media.schema, document);
        const text = typeof example === "string" ? example : JSON.stringify(example, null, 2);
        return (
          <div key={type} class="content">
            <p>
              <code>{type}</code>
            </p>
            {media.schema && <Properties schema={media.schema} document={document} />}
            {text !== undefined && text !== "{}" && (
              <details>
                <summary>{t("docs.example", { what: `${what}, ${type}` })}</summary>
                <Code text={text} label={t("docs.copy_example", { what: `${what}, ${type}` })} />
              </details>
            )}
          </div>
        );
      })}
    </>
  );
}

function Answers({ answers, document }: { answers: Record<string, Answer>; document: ApiDocument }) {
  const [good, bad] = [true, false].map((wanted) =>
    Object.entries(answers).filter(([status]) => status.startsWith("2") === wanted),
  ) as [[string, Answer][], [string, Answer][]];
  return (
    <>
      <h4>{t("docs.answers")}</h4>
      {good.map(([status, answer]) => (
        <div key={status}>
          <p>
            <strong>{status}</strong>{" "}
            <span lang="en">
              <Words text={answer.description} />
            </span>
          </p>
          {answer.content && <Contents content={answer.content} document={document} what={status} />}
        </div>
      ))}
      <ul class="answers">
        {bad.map(([status, answer]) => (
          <li key={status}>
            <strong>{status}</strong>{" "}
            <span lang="en">
              <Words text={answer.description} />
            </span>
          </li>
        ))}
      </ul>
    </>
  );
}

function Body({ operation, document }: { operation: Operation; document: ApiDocument }) {
  const sends = operation.requestBody;
  return (
    <div class="body">
      <Prose text={operation.description} />
      {operation.parameters && <Parameters parameters={operation.parameters} document={document} />}
      {sends && (
        <>
          <h4>{t("docs.body")}</h4>
          <Prose text={sends.description} />
          <Contents content={sends.content} document={document} what={t("docs.body")} />
        </>
      )}
      <Answers answers={operation.responses} document={document} />
      <h4>{t("docs.shell")}</h4>
      <Code text={curlOf(operation, location.origin, document)} label={t("docs.copy_line")} />
      {operation.method === "GET" && (
        <>
          <h4>{t("docs.here")}</h4>
          <Try operation={operation} document={document} />
        </>
      )}
    </div>
  );
}

function Entry({ operation, document }: { operation: Operation; document: ApiDocument }) {
  const [open, fold] = useFold(operation.id);
  return (
    <details
      id={operation.id}
      class="operation"
      open={open}
      onToggle={(event) => event.currentTarget.open !== open && fold(event.currentTarget.open)}
    >
      <summary>
        <span class={`method ${operation.method.toLowerCase()}`}>{operation.method}</span>{" "}
        <code>{operation.path}</code>{" "}
        <span class="what" lang="en">
          {operation.summary}
        </span>
      </summary>
      {open && <Body operation={operation} document={document} />}
    </details>
  );
}

/** All groups. */
export function Reference({ groups, document }: { groups: Group[]; document: ApiDocument }) {
  return (
    <>
      {groups.map((group) => (
        <section key={group.tag} aria-labelledby={group.tag}>
          <h3 id={group.tag} class="tag" lang="en">
            <a class="self" href={`#${group.tag}`}>
              {group.tag}
            </a>
          </h3>
          <p class="quiet-text" lang="en">
            {group.description}
          </p>
          {group.operations.map((one) => (
            <Entry key={one.id} operation={one} document={document} />
          ))}
        </section>
      ))}
    </>
  );
}
