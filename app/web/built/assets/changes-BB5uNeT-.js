var e=`<h1 id="following-the-map">Following the map</h1>
<p>Who keeps a copy of the map (a router, a cache, another database) reads it once and then what changed. What changed is noted by triggers of the database, whatever program writes: a segment that came or went, and every change of a property that outputs have, its line included. What no output shows is not noted.</p>
<h2 id="the-feed"><a class="self" href="#the-feed">The feed</a></h2>
<pre tabindex="0"><code>curl http://127.0.0.1:8000/v1/changes                                  # {&quot;version&quot;: &quot;k3v7qmx2ab-184467&quot;, &quot;changes&quot;: [], ...}: keep the version,
curl 'http://127.0.0.1:8000/collections/segments/items?limit=1000'     # then read everything, by its \`next\` links
curl 'http://127.0.0.1:8000/v1/changes?since=k3v7qmx2ab-184467'        # from then on: what changed, and the version to go on from
</code></pre>
<p>Each entry is <code>{id, changed_at, gone}</code>, in the order in which the changes came; of several changes of a segment the last counts. Follow <code>next</code> until there is none, and keep the last <code>version</code>, for a minute or a month. It may be asked again at any moment, also in the middle of the pages: each page's <code>version</code> is a place to go on from. A segment that changes
while somebody reads comes again at the end. <code>gone</code> with an id that you do not know: it came and went meanwhile.</p>
<p><code>bbox=west,south,east,north</code> (degrees; west &gt; east: across the antimeridian) tells of segments that are there, and of those that were there and have moved away or are gone. A page looks at 10,000 changes at most; it may hold fewer entries than <code>limit</code>, even none, and still have a <code>next</code> link.</p>
<p>The answer's <code>ETag</code> is the present version: with <code>If-None-Match</code> a request costs one look into an index, and 304, for as long as nothing changes.</p>
<p><strong>410</strong> says that nobody can go on from a version: the database was restored or is another one, or segments that went since are forgotten (after <code>VERSANT_CHANGES_KEPT_DAYS</code>). Begin anew.</p>
<h2 id="what-a-version-is"><a class="self" href="#what-a-version-is">What a version is</a></h2>
<p>A moment is the number of a transaction. Numbers are given out when transactions begin to write, and they end in any order, so &quot;all up to the highest number&quot; misses whoever ends late. What is told therefore ends at the <strong>horizon</strong>: below it every transaction has ended. From one version to the next each change is told exactly once, whatever the order (<code>tests/app/changes/test_histories.py</code> tries it with drives,
removals, imports and others that write beside them, against a comparison of everything with everything). A transaction that writes for minutes, in whatever database of the server, delays what is told by as much, and loses nothing.</p>
<p>The version is the lowest moment that is as good as the horizon: one after the last change below it. So it stays the same while nothing changes, and it holds after a crash of the server: numbers of transactions that left nothing are given out again then.</p>
<p>Numbers are one server's. The word in front of the number names the database's <strong>epoch</strong>: random, and begun anew where the database was restored (<code>versant restore</code>, or <code>pg_restore</code> by hand, also over the one that was there), copied, brought to another server by <code>pg_upgrade</code> or a base backup, or recovered to an earlier moment. That is found out at the next question or by a worker
within half a minute (until a worker has numbered a large map anew, some twenty seconds for a million segments, the answer is 503): the row that holds the epoch names server, database and timeline, and the transaction that wrote it. Numbers that are higher than the present server's are then put before all others, in <code>segment_changes</code> and in <code>cells</code>. <strong>One case is not found out</strong>: the folder of a stopped server put back as it was yesterday, by copying files. Then begin a new epoch yourself:
<code>DELETE FROM change_epoch</code> in the database.</p>
<p>Inside the service, <code>app.changes.store</code> has what others need: <code>horizon</code>, <code>version_text</code>, <code>parse_version</code>, and <code>changed_since_sql</code>, the condition behind <code>updated_since</code>. <code>updated_since</code> takes a version or a time (RFC 3339). A version is exact. <strong>A time is for the beginning</strong>: a change carries the time at which it was written and is seen when its transaction ends, so who goes on by times has to overlap them; who goes
on by the version in the answer misses nothing. Items cannot show what is gone: the feed does.</p>
<p>Who keeps what it has read of <code>cells.changed_xid</code> in memory keeps the epoch beside it, and forgets everything where that is another one.</p>
<h2 id="webhooks"><a class="self" href="#webhooks">Webhooks</a></h2>
<pre tabindex="0"><code>curl -X POST http://127.0.0.1:8000/v1/webhooks -H 'Content-Type: application/json' \\
     -d '{&quot;url&quot;: &quot;https://example.org/versant&quot;, &quot;events&quot;: [&quot;segments.changed&quot;, &quot;drive.failed&quot;], &quot;bbox&quot;: [8.46, 48.95, 8.50, 48.99]}'
</code></pre>
<p>The answer has the <code>secret</code>, this once. Messages follow <a href="https://www.standardwebhooks.com" rel="noreferrer">Standard Webhooks</a>: a POST of <code>{&quot;type&quot;, &quot;timestamp&quot;, &quot;data&quot;}</code> with the headers <code>webhook-id</code>, <code>webhook-timestamp</code> and <code>webhook-signature</code> (<code>v1,</code> and the HMAC-SHA256 of <code>id.timestamp.body</code> in base64, by the bytes of the secret after <code>whsec_</code>), for which there are libraries in most
languages. Check the signature and that the time is near; the same id may come twice.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th><code>type</code></th>
<th>when</th>
<th><code>data</code></th>
</tr>
</thead>
<tbody>
<tr>
<td><code>segments.changed</code></td>
<td>segments changed (in the box) since the last such message that was taken; at most every ten seconds, one at a time</td>
<td><code>since</code>, <code>version</code>, <code>segments</code> and <code>gone</code> (how many), <code>counted_all</code> (false: there are more than were counted). <code>since</code> null: begin anew</td>
</tr>
<tr>
<td><code>drive.done</code></td>
<td>a drive's slopes are on the map</td>
<td><code>drive_id</code>, <code>method</code>, <code>segments</code></td>
</tr>
<tr>
<td><code>drive.failed</code></td>
<td>a drive failed</td>
<td><code>drive_id</code>, <code>kind</code>, <code>reason</code></td>
</tr>
<tr>
<td><code>test</code></td>
<td><code>POST /v1/webhooks/{id}/test</code></td>
<td><code>webhook_id</code></td>
</tr>
</tbody>
</table></div>
<p><code>segments.changed</code> does not say which: ask <code>/v1/changes?since=</code>. What changes while a message waits is in the next one. A drive's message commits together with the drive's end: none is lost, and none tells of what did not come to be.</p>
<p>Any status of 2xx takes a message. Anything else, a redirect too, and no answer within <code>VERSANT_WEBHOOK_TIMEOUT_S</code>, is a failure: the message comes again after 5 and 30 seconds, 2, 10 and 30 minutes, then every hour, and the address is left alone for as long. After <code>VERSANT_WEBHOOK_PATIENCE_DAYS</code> of failures, or at once by a 410, it is switched off and what waited is given up; <code>GET /v1/webhooks/{id}</code> says why and shows the newest messages, those that ended for a week. <code>PATCH</code> with <code>{&quot;active&quot;: true}</code> switches it on again: of segments it is then told all that it missed, of drives not.</p>
<p><strong>Which addresses are called.</strong> There is no access control yet, so whoever reaches the API could make the service call what only it reaches. So by default only public addresses are called, and by https; <code>VERSANT_WEBHOOK_PRIVATE=true</code> allows this machine, private networks and plain http. The name is looked up for each message, and the connection goes to the address that was found and allowed. Public is what is given out to be reached from everywhere: of version 6 only <code>2000::/3</code> without tunnels (6to4, Teredo) and documentation, and <code>64:ff9b::/96</code> by the address of version 4 inside; no multicast, no mapped or compatible addresses, no networks for tests.
Redirects are not followed and proxies of the environment not used. Who lists webhooks sees their addresses; secrets are not shown, but they are in the database and in its backups. After <code>versant restore</code> all are switched off, so that a copy tells nobody: switch them on where it takes the former one's place.</p>
<p>Messages are sent by the workers, beside their jobs: eight at once in each process that has chores (one of each <code>versant worker</code>), one at a time to an address. They are no jobs of the queue, whose lanes are for what computes: there a receiver that hangs would keep drives waiting. A worker that dies with a message on its way leaves it to another a minute later.</p>
`;export{e as default};