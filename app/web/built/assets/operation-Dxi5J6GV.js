var e=`<h1 id="operation">Operation</h1>
<p>What operators see of a running service: lines of the log, metrics, traces, and drives with what became of them. None of it tells where anybody drove. Deployment, backups and updates are in the <span>README</span>, all settings <span>there</span>; what is tried against a service, and what a proxy in front has to do, in <a href="/docs/threats">threats</a>.</p>
<h2 id="logs"><a class="self" href="#logs">Logs</a></h2>
<p>Every process logs to standard error, one line for each request and each event of a drive. <code>VERSANT_LOG_FORMAT=text</code> (the default) is for people, <code>VERSANT_LOG_FORMAT=json</code> for programs: one JSON object a line, with the same fields. <code>VERSANT_LOG_LEVEL</code> says from which severity on.
What the server, the queue and libraries say goes the same way; Python's warnings as well. Commands (<code>versant import-roads</code> ...) log only where the environment sets one of the two, for they speak to a person.</p>
<pre tabindex="0"><code>2026-11-23T04:00:01.204Z INFO api[411] app.core.telemetry.requests: request request=5c0f... method=POST route=/v1/drives path=/v1/drives status=202 seconds=0.041 bytes=201
2026-11-23T04:00:02.310Z INFO worker 1[412] app.drives.process: drive computed job=17 drive=3f1c... method=profile epochs=549 segments=80 reading_s=0.121 positioning_s=0.002 roads_s=0.044 estimating_s=0.61 saving_s=0.029
</code></pre>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>field</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>time</code>, <code>level</code>, <code>process</code>, <code>logger</code>, <code>event</code></td>
<td>on every line; <code>process</code> with its number: <code>api[411]</code>, <code>worker 2[413]</code>, <code>command[500]</code></td>
</tr>
<tr>
<td><code>request</code></td>
<td>number of the request: taken from <code>X-Request-ID</code> where that is one (up to 64 letters, digits, <code>.</code>, <code>_</code>, <code>-</code>), else made; every answer returns it in <code>X-Request-ID</code></td>
</tr>
<tr>
<td><code>drive</code>, <code>job</code>, <code>batch</code>, <code>export</code>, <code>operation</code></td>
<td>what the line is about; all lines of a run have its <code>drive</code> and its <code>job</code></td>
</tr>
<tr>
<td><code>error</code></td>
<td>(JSON) the traceback; in text it follows the line</td>
</tr>
</tbody>
</table></div>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>event</th>
<th>when</th>
<th>figures</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>request</code></td>
<td>a request was answered; at DEBUG for <code>/healthz</code>, <code>/readyz</code> and <code>/metrics</code>, a WARNING from status 500 on</td>
<td><code>method</code>, <code>route</code> (the template), <code>path</code>, <code>query</code> (names alone), <code>status</code>, <code>seconds</code>, <code>bytes</code></td>
</tr>
<tr>
<td><code>drive uploaded</code>, <code>drive uploaded again</code></td>
<td>a log was stored and queued; its content was known</td>
<td><code>bytes</code>, <code>method</code>, <code>state</code></td>
</tr>
<tr>
<td><code>drive queued again</code>, <code>batch queued</code></td>
<td>one drive, many drives were asked for anew</td>
<td><code>run</code>; <code>drives</code>, <code>which</code></td>
</tr>
<tr>
<td><code>drive started</code></td>
<td>a worker has begun with it</td>
<td><code>waited_s</code>, <code>bytes</code></td>
</tr>
<tr>
<td><code>drive computed</code></td>
<td>it has said all, and waits for its squares to be solved</td>
<td>seconds of each stage, <code>epochs</code>, <code>segments</code></td>
</tr>
<tr>
<td><code>drive done</code></td>
<td>its slopes are published</td>
<td><code>km</code>, <code>segments</code>, <code>rejected_segments</code>, <code>warnings</code>, <code>publishing_s</code></td>
</tr>
<tr>
<td><code>drive failed</code></td>
<td>an ERROR where it is the fault of the service (<code>internal</code>, <code>out-of-memory</code>, <code>interrupted</code>), else INFO</td>
<td><code>kind</code>, <code>stage</code>, <code>reason</code></td>
</tr>
<tr>
<td><code>drive put back</code>, <code>drive discarded</code>, <code>drive skipped</code></td>
<td>its worker stops; it was deleted or asked for anew</td>
<td><code>reason</code></td>
</tr>
<tr>
<td><code>drive cancelled</code>, <code>drive deleted</code></td>
<td>its removal was asked for; nothing of it is left</td>
<td></td>
</tr>
<tr>
<td><code>removal of drives asked for</code>, <code>drives cancelled</code></td>
<td>of many at once; all of them are cancelled, and go one by one</td>
<td><code>drives</code></td>
</tr>
<tr>
<td><code>squares solved</code></td>
<td>slopes of a part of the map were computed and published (<code>marked</code>: for drives; <code>settled</code>: in the background)</td>
<td><code>squares</code>, <code>segments</code>, <code>tries</code>, <code>seconds</code></td>
</tr>
<tr>
<td><code>webhook sent</code></td>
<td>a message went to an address, which has its number alone here</td>
<td><code>webhook</code>, <code>kind</code>, <code>outcome</code> (<code>taken</code>, <code>not taken</code>, <code>switched off</code>), <code>status</code>, <code>seconds</code></td>
</tr>
<tr>
<td><code>tiles taken away</code></td>
<td>vector tiles that nobody had asked for longest made room</td>
<td><code>tiles</code></td>
</tr>
<tr>
<td><code>tile not kept</code>, <code>tiles not refreshed</code></td>
<td>a WARNING: a tile was answered, but the database did not keep it; (DEBUG) what is asked for often could not be built anew</td>
<td><code>reason</code></td>
</tr>
<tr>
<td><code>export asked for</code>, <code>export done</code>, <code>export failed</code></td>
<td>a file was asked for; it is there; it cannot be made, a WARNING</td>
<td><code>format</code>, <code>bytes</code>, <code>seconds</code>; <code>kind</code>, <code>reason</code></td>
</tr>
<tr>
<td><code>operation asked for</code>, <code>operation done</code>, <code>operation failed</code></td>
<td>the operator asked for long work; it is done; it cannot be, a WARNING</td>
<td><code>kind</code>, <code>reason</code></td>
</tr>
<tr>
<td><code>trial done</code>, <code>trial failed</code>, <code>trial discarded</code></td>
<td>a drive was tried by another method; it cannot be; it or its drive was removed meanwhile</td>
<td><code>method</code>, <code>seconds</code>; <code>kind</code>, <code>stage</code>; <code>reason</code></td>
</tr>
<tr>
<td><code>roads imported</code>, <code>elevation imported</code>, <code>control points imported</code>, <code>import of ... failed</code></td>
<td></td>
<td><code>seconds</code>, counts; <code>reason</code></td>
</tr>
</tbody>
</table></div>
<p><strong>Nothing of a track is logged</strong>: no coordinates, no squares or tiles, no values of queries (a box is where somebody lives, or looks), no content of files. The name of a file may be a person's, so it is told at DEBUG alone, and blanked in reasons. Numbers with four decimals or more and geometries are
blanked in every line, whoever wrote it, and in every reason of a failure before it is stored; and the database's errors come without their parameters.</p>
<h2 id="metrics"><a class="self" href="#metrics">Metrics</a></h2>
<p><code>/metrics</code> of any API process has all there is, also what workers and imports count: each process keeps its totals in a row of its own (<code>process_totals</code>), written every five seconds, and the API adds them up. So no further port has to be reached, whatever the number of workers, under <code>versant up</code> too; a
worker that is killed loses its last seconds, and no counter falls when one ends or is restarted. Of several API processes each has its own requests (<code>versant_http_*</code>), and the same of all else: sum the former, take the maximum of the latter.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>metric</th>
<th>kind</th>
<th>labels</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>versant_http_requests_total</code></td>
<td>counter</td>
<td><code>method</code> <code>route</code> <code>status</code></td>
<td>Requests answered.</td>
</tr>
<tr>
<td><code>versant_http_request_duration_seconds</code></td>
<td>histogram</td>
<td><code>method</code> <code>route</code></td>
<td>Time from a request to the last byte of its answer.</td>
</tr>
<tr>
<td><code>versant_database_up</code></td>
<td>gauge</td>
<td></td>
<td>1 while the database answers.</td>
</tr>
<tr>
<td><code>versant_drives</code></td>
<td>gauge</td>
<td><code>status</code></td>
<td>Drives by status.</td>
</tr>
<tr>
<td><code>versant_queue_depth</code></td>
<td>gauge</td>
<td></td>
<td>Drives that wait.</td>
</tr>
<tr>
<td><code>versant_queue_oldest_wait_seconds</code></td>
<td>gauge</td>
<td></td>
<td>How long the drive at the head of the queue has waited; 0 while none waits.</td>
</tr>
<tr>
<td><code>versant_data_version</code></td>
<td>gauge</td>
<td></td>
<td>Number of the published data.</td>
</tr>
<tr>
<td><code>versant_squares_waiting</code></td>
<td>gauge</td>
<td></td>
<td>Squares of the map that wait to be solved.</td>
</tr>
<tr>
<td><code>versant_squares_unsolved</code></td>
<td>gauge</td>
<td></td>
<td>Squares of the map that solvers have begun with again and again in vain; /v1/admin/stats names them.</td>
</tr>
<tr>
<td><code>versant_derived_behind_seconds</code></td>
<td>gauge</td>
<td></td>
<td>How long the oldest change of segments has waited to be shown by ways and low zooms; 0 while none waits.</td>
</tr>
<tr>
<td><code>versant_failures</code></td>
<td>gauge</td>
<td><code>kind</code></td>
<td>Drives that are failed now, by the kind of the failure.</td>
</tr>
<tr>
<td><code>versant_workers</code></td>
<td>gauge</td>
<td></td>
<td>Processes that take drives from the queue and are alive.</td>
</tr>
<tr>
<td><code>versant_drives_done_total</code></td>
<td>counter</td>
<td><code>method</code></td>
<td>Drives computed and published.</td>
</tr>
<tr>
<td><code>versant_drives_failed_total</code></td>
<td>counter</td>
<td><code>kind</code> <code>method</code></td>
<td>Runs of drives that failed, by the kind of the failure.</td>
</tr>
<tr>
<td><code>versant_drives_put_back_total</code></td>
<td>counter</td>
<td><code>method</code> <code>reason</code></td>
<td>Runs of drives that ended without a result: their worker stopped, or the drive was deleted or asked for anew.</td>
</tr>
<tr>
<td><code>versant_drive_queued_seconds</code></td>
<td>histogram</td>
<td></td>
<td>From the request for a drive to the start of its run.</td>
</tr>
<tr>
<td><code>versant_drive_stage_seconds</code></td>
<td>histogram</td>
<td><code>method</code> <code>stage</code></td>
<td>Stages of the runs of drives; <code>publishing</code> is the wait for the squares to be solved.</td>
</tr>
<tr>
<td><code>versant_solve_seconds</code></td>
<td>histogram</td>
<td><code>kind</code></td>
<td>Solutions of squares of the map from the look at the database to the swap: <code>marked</code> for drives, <code>settled</code> in the background.</td>
</tr>
<tr>
<td><code>versant_squares_solved_total</code></td>
<td>counter</td>
<td><code>kind</code></td>
<td>Squares in these solutions.</td>
</tr>
<tr>
<td><code>versant_swap_conflicts_total</code></td>
<td>counter</td>
<td><code>kind</code></td>
<td>Solutions found out of date when they were to be written, and made again.</td>
</tr>
<tr>
<td><code>versant_lock_wait_seconds</code></td>
<td>histogram</td>
<td><code>lock</code></td>
<td>Waits for locks: <code>own_network</code> (imports), <code>share_network</code> (drives), <code>own_hours</code> (drives of the same hours).</td>
</tr>
<tr>
<td><code>versant_imports_total</code></td>
<td>counter</td>
<td><code>kind</code> <code>outcome</code></td>
<td>Imports of roads, elevation and surveyed heights.</td>
</tr>
<tr>
<td><code>versant_import_seconds</code></td>
<td>histogram</td>
<td><code>kind</code></td>
<td>Imports, from file to commit.</td>
</tr>
</tbody>
</table></div>
<p><strong>A dashboard</strong>: <a href="/web/assets/grafana-DW7x106J.json">grafana.json</a> draws all of them. In Grafana: Dashboards, New, Import; it asks for the Prometheus that scrapes <code>/metrics</code>. Worth an alarm: <code>versant_database_up</code> 0, <code>versant_workers</code> 0, <code>versant_queue_oldest_wait_seconds</code> that grows, <code>versant_squares_unsolved</code> above 0, <code>versant_derived_behind_seconds</code> above 600 (no worker runs, or a transaction has been open for so long),
<code>versant_drives_failed_total</code> with the kinds <code>internal</code> and <code>out-of-memory</code>.</p>
<p><code>/v1/admin/stats</code> tells the queue's depth and age, failures by kind, and squares that cannot be solved, as JSON.</p>
<h2 id="clients"><a class="self" href="#clients">Clients</a></h2>
<p>What a client is to all limits: an IPv4 address, or the first 64 bits of an IPv6 address. Nothing below is a defence against many addresses at once; that is for what stands in front.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>what</th>
<th>bound</th>
<th>beyond it</th>
</tr>
</thead>
<tbody>
<tr>
<td>connections of a process</td>
<td><code>VERSANT_CONNECTIONS_MAX</code>, at least 250 less than the files that the system allows it (the API raises its own limit to the system's)</td>
<td>the longest silent connection of whoever has most of them is closed</td>
</tr>
<tr>
<td>connections of a client</td>
<td><code>VERSANT_CONNECTIONS_PER_CLIENT</code></td>
<td>its longest silent one is closed; with a request on each, 503, but for <code>/healthz</code> and <code>/readyz</code></td>
</tr>
<tr>
<td>head of a request</td>
<td><code>VERSANT_HEAD_TIMEOUT_S</code>; 32 KiB, 200 fields</td>
<td>408 or closed; 431</td>
</tr>
<tr>
<td>body of a change</td>
<td><code>VERSANT_BODY_TIMEOUT_S</code>; 64 KiB; read before anything is begun for it</td>
<td>408; 413</td>
</tr>
<tr>
<td>upload, import</td>
<td>1000 bytes for each second of <code>VERSANT_UPLOAD_STALL_S</code> that the service waits for them</td>
<td>408</td>
</tr>
<tr>
<td>requests before the first answer on a connection</td>
<td>16</td>
<td>closed</td>
</tr>
<tr>
<td>answer that nobody takes</td>
<td>60 s without a byte</td>
<td>closed</td>
</tr>
<tr>
<td>event streams</td>
<td><code>VERSANT_EVENTS_MAX</code>, <code>VERSANT_EVENTS_PER_CLIENT</code></td>
<td>503; a page asks again</td>
</tr>
<tr>
<td>slow kinds of requests</td>
<td><a href="#lanes">lanes</a></td>
<td>they wait 10 s at most, then 503</td>
</tr>
</tbody>
</table></div>
<p>Of streams, connections with a request, and places in lanes a client may hold no more than are left: one alone half of them, two a third each. So there is always one for who has none.</p>
<h3 id="lanes"><a class="self" href="#lanes">Lanes</a></h3>
<p>Requests of a kind that can be slow (tiles, wide tiles, pages of items, searches of items, parts of drives and heights, changes, figures) wait for each other and for no other kind; pages of items with a filter, a sort order or conditions are searches and do not hold up those without. Of each kind one client works on as many at once as suit a
machine, and there are places beside these that only others may have. Of those who wait the client comes next that holds fewest places, then who has waited longest.</p>
<h3 id="behind-a-proxy"><a class="self" href="#behind-a-proxy">Behind a proxy</a></h3>
<p>A proxy (TLS, names, logins) in front of the API <strong>must</strong>:</p>
<ul>
<li>be named in <code>VERSANT_TRUSTED_PROXIES</code> by the address from which it connects. Else all its users are one client and share what one client may have; the log warns once when a request says that it was forwarded by somebody who is not named. <code>X-Forwarded-For</code> and <code>X-Forwarded-Proto</code> are believed from the named alone, also in the audit;</li>
<li><strong>append</strong> the address it hears from to <code>X-Forwarded-For</code> (nginx: <code>proxy_set_header X-Forwarded-For $proxy_add_x_forwarded_for</code>): the client is the last address there that is no named proxy. And <strong>overwrite</strong> <code>X-Forwarded-Proto</code> (<code>proxy_set_header X-Forwarded-Proto $scheme</code>), which links begin with;</li>
<li>pass <code>Host</code> on (<code>proxy_set_header Host $host</code>), with <code>VERSANT_ALLOWED_HOSTS</code> or <code>VERSANT_PUBLIC_URL</code> naming it. <code>X-Forwarded-Host</code> and <code>Forwarded</code> are believed from nobody;</li>
<li>limit connections and requests for each client itself, and time out heads and bodies (nginx: <code>limit_conn</code>, <code>limit_req</code>, <code>client_header_timeout</code>, <code>client_body_timeout</code>): the service's own limits of connections do not count those of a named proxy, only the requests on them;</li>
<li>let <code>/v1/drives/*/events</code> and <code>/v1/changes/events</code> through unbuffered for ten minutes (<code>proxy_read_timeout 660s</code>; the service says <code>X-Accel-Buffering: no</code>), uploads up to <code>VERSANT_MAX_UPLOAD_BYTES</code> (<code>client_max_body_size</code>), and keep no more connections to the API than <code>VERSANT_CONNECTIONS_MAX</code>.</li>
</ul>
<p>Pages of other origins read nothing unless <code>VERSANT_CORS_ORIGINS</code> names them (<code>*</code>: any), and then the map alone, never drives. A service on loopback that lets any page read the map tells every site that its user visits where that user drives.</p>
<h2 id="queries"><a class="self" href="#queries">Queries</a></h2>
<p><code>/v1/admin</code> lists the queries that there are, with each of their columns; <code>/v1/admin/{name}</code> answers one, as JSON or, with <code>f=csv</code>, as a table. What takes a look at the whole map (<code>coverage</code>, <code>sigmas</code>, <code>disagreements</code>, <code>terrain</code>, <code>tiles</code>) a worker makes again every ten minutes while the map changes; <code>as_of</code> tells of which moment it is.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>query</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>attention</code></td>
<td>what needs a person, the worst first, with a sentence and where it is listed; empty while all is well</td>
</tr>
<tr>
<td><code>throughput</code>, <code>growth</code></td>
<td>what ended in each hour (<code>days=2</code>) or on each day, with medians of its stages; kilometres driven by road class at the end of each day</td>
</tr>
<tr>
<td><code>drives</code>, <code>failures</code></td>
<td>by day of the upload and status; by reason, with the latest of each (<code>days=</code>)</td>
</tr>
<tr>
<td><code>queue</code>, <code>times</code></td>
<td>what waits and runs, with the longest wait; medians and 95 % of waiting, computing and publishing by method</td>
</tr>
<tr>
<td><code>coverage</code>, <code>sigmas</code></td>
<td>kilometres there are and kilometres driven by region and road class; segments by sigma and number of drives</td>
</tr>
<tr>
<td><code>disagreements</code>, <code>terrain</code></td>
<td>segments on which drives contradict each other; tiles in which the elevation model is off</td>
</tr>
<tr>
<td><code>storage</code>, <code>tiles</code></td>
<td>logs and tables by size; kept tiles by zoom, and how many are older than the map</td>
</tr>
<tr>
<td><code>versions</code>, <code>audit</code></td>
<td>of program, schema, server, roads and elevation; who removed what over HTTP, or asked for work in bulk</td>
</tr>
</tbody>
</table></div>
<p>On 1,000,000 segments and 100,000 drives each takes less than a tenth of a second (<code>PYTHONPATH=.:benchmarks python -m service.admin_queries</code>).</p>
<p>A row of <code>audit</code> is written in the transaction that it tells of. It names ids, no files and no places; the latest 100,000 rows are kept. Until there is a login, its <code>origin</code> is the client's address and the first 80 characters of its program's name; behind a proxy <a href="#behind-a-proxy">that is named</a> the address is its client's, else the proxy's.</p>
<h2 id="operations"><a class="self" href="#operations">Operations</a></h2>
<p><code>GET /v1/regions</code> and <code>GET /v1/rasters</code> list what the slopes stand on. What takes long is a job of the workers, asked for at <code>/v1/operations</code>:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th><code>POST /v1/operations?kind=</code></th>
<th>with</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>import-roads</code></td>
<td>a file; <code>region=</code></td>
<td>as <code>versant import-roads</code>, also of changes (<code>.osc</code>)</td>
</tr>
<tr>
<td><code>import-dem</code></td>
<td>a file (GeoTIFF, COG, HGT or DTED, also gzipped); <code>priority=</code></td>
<td>as <code>versant import-dem</code>, at once</td>
</tr>
<tr>
<td><code>remove-region</code>, <code>remove-raster</code></td>
<td><code>name=</code></td>
<td>as <code>versant regions remove</code>, <code>versant elevation remove</code></td>
</tr>
<tr>
<td><code>settle</code></td>
<td></td>
<td>as <code>versant settle</code>, at once</td>
</tr>
</tbody>
</table></div>
<p>A raster that comes this way is opened by one driver, chosen by its first bytes, and no file or address that it names is: VRT and all other formats are for <code>versant import-dem</code>, which keeps them as one GeoTIFF. Rasters that a version before kept in another
format (imported from .img, .asc ...) are not read any more: <code>versant elevation list</code> names them, import them again on the command line. It may have <code>VERSANT_MAX_RASTER_POSTS</code> posts and unpack to <code>VERSANT_MAX_IMPORT_BYTES</code>; <code>VERSANT_MIN_FREE_BYTES</code> stay free
while it is copied and unpacked. Fifty operations may wait or be planned, and their files take <code>VERSANT_IMPORTS_KEPT_BYTES</code> at most. A file of roads that unpacks to more than 20 (PBF) or 50 times (gzip) its size is refused before it is read.</p>
<p>Imports of roads and removals first say what they would do (<code>plan</code>) and wait as <code>planned</code>, for a week at most. <code>POST /v1/operations/ID/approve</code> carries the plan out, and only that: where other segments would change by now, or a tenth more would lose what was measured, nothing is done and the operation is planned anew. <code>DELETE</code> drops what has changed nothing yet.
One runs at a time, behind uploads and exports: where all lanes are taken it goes back into the queue for them, at first at once, then after 20 s, 60 s, 140 s ..., so it comes to its end. A run whose worker died goes on where it stood. A run that takes longer than <code>VERSANT_RUN_LIMIT_S</code> fails; asked for again, an import goes on with the rest. Files are taken up to
<code>VERSANT_MAX_IMPORT_BYTES</code>, lie in the blob store until the operation ends, and are in no backup.</p>
<p><code>POST /v1/drives/remove</code> removes many drives, chosen as by <code>reprocess</code> or by <code>ids=</code>; <code>dry_run=true</code> shows how many, their length and the size of their logs. It cannot be called off.</p>
<h2 id="removal"><a class="self" href="#removal">Removal</a></h2>
<p><code>DELETE /v1/drives/{id}</code>, <code>POST /v1/drives/remove</code> and <code>versant drives delete</code> remove for good.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>when</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td>with the answer</td>
<td>the drive and all its parts are 404 for everybody, in lists, searches, observations and events too, whatever runs. Its file's name, report, hashes, track, picture, trials (one that runs ends) and messages to webhooks are deleted. <code>/v1/admin/queue</code> counts removals that are under way, without a name</td>
</tr>
<tr>
<td>as soon as a lane is free</td>
<td>what it said is taken back, its log is deleted</td>
</tr>
<tr>
<td>within seconds, once its squares are solved</td>
<td>slopes are what they are without it; its row goes, with kept tiles of its surroundings and what the attic kept of it. Exports of maps that reach to within 0.1 degrees of it are <code>cancelled</code> and their files deleted; one that is being made begins anew</td>
</tr>
<tr>
<td>within ten minutes</td>
<td>kept figures of the map (<code>terrain</code>, <code>disagreements</code>) are made again</td>
</tr>
</tbody>
</table></div>
<p>Until its squares are solved the slopes of the map, which name nobody, still rest on it; ways and low zooms follow a moment later. Where a square cannot be solved the row stays, with id, box and size alone, and <code>attention</code> says so.</p>
<p><strong>What stays</strong>: in <code>audit_log</code> that the drive of this id was removed, when and by whom; in totals that there was one. <code>cells</code> and <code>segment_changes</code> say of squares and roads, by number, that what is shown of them changed and when: who follows the
map has to hear that a slope is gone. That is a trace of where something was driven and removed, until the next change there; nobody without the database sees more of it than <code>/v1/changes</code> tells. Box filters of requests are kept neither in the audit log nor in batches. At <code>VERSANT_LOG_LEVEL=DEBUG</code> the log names files. PostgreSQL
overwrites deleted rows when it vacuums, and its write-ahead log goes round: neither is in a dump.</p>
<p><strong>What it does not reach</strong>: backups of before (they hold drive and log; a restored one brings them back, to be removed again), archives of the write-ahead log, lines of logs that others collect, files that somebody fetched, answers that a CDN keeps (<code>VERSANT_TILE_MAX_AGE_S</code>), and messages that webhooks were sent.</p>
<h2 id="traces"><a class="self" href="#traces">Traces</a></h2>
<p><code>pip install 'versant[otel]'</code> (the Docker image has it) and <code>VERSANT_OTLP_ENDPOINT=http://collector:4318</code>, for API and workers, send OpenTelemetry traces over OTLP/HTTP: a span for each request (named by its route), for each run of a drive and each stage of it, for solutions and imports. A <code>traceparent</code> header of a
request is taken on, and goes with the drive to the worker: upload and run are one trace. Attributes begin with <code>versant.</code> and are the fields of the log, so nothing of a track is in them either. Without the variable nothing that makes spans is loaded. What the collector does not take is dropped.</p>
<h2 id="drives"><a class="self" href="#drives">Drives</a></h2>
<p><code>versant drives list</code> names drives with file, status, length, segments and the reason of a failure; <code>--status</code>, <code>--failure KIND</code>, <code>--since TIME</code> and <code>--batch N</code> choose. <code>versant drives show ID</code> tells one in full, with its warnings. <code>versant drives delete ID...</code> ends with status 1 where one of them is not there.</p>
<p><code>versant drives reprocess</code> lets drives be computed again:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>with</th>
<th>which drives</th>
</tr>
</thead>
<tbody>
<tr>
<td>nothing</td>
<td>those that are not of the method already: the service's default, or <code>--method NAME</code></td>
</tr>
<tr>
<td><code>--stale</code></td>
<td>whose estimates another version of the code, or other defaults, made</td>
</tr>
<tr>
<td><code>--failed</code>, <code>--failure KIND</code></td>
<td>that failed; that failed so</td>
</tr>
<tr>
<td><code>--all</code></td>
<td>all that are done or failed</td>
</tr>
<tr>
<td><code>--drive ID</code></td>
<td>these</td>
</tr>
</tbody>
</table></div>
<p>Filters (<code>--bbox</code>, <code>--from-method</code>, <code>--created-after</code> ...) narrow the first four, and <code>--dry-run</code> counts the same drives that a run would take. <strong>Left out</strong> are failed drives whose log itself cannot be used (<code>unknown-format</code>, <code>empty-log</code>, <code>malformed-log</code>, <code>bad-log</code>), for the same code would find the same: how many, of which kind, is said. They are taken along
by <code>--force</code>, by naming their kind (<code>--failure</code>) or themselves (<code>--drive</code>), and by themselves once another version of the code is installed. Where nothing is chosen the command says why and ends with status 0. <code>--wait</code> waits for all of them, names each that failed with file and reason, and ends with status 1 then.</p>
`;export{e as default};