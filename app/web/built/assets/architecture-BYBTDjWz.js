var e=`<h1 id="the-house">The house</h1>
<p>Read this first. It tells the way of one drive through the code, what each room is for, how to add a thing, and why the large choices were made. The methods are explained in <a href="/docs/methods">methods.md</a>, how drives are solved together in <a href="/docs/network">network.md</a>.</p>
<p>Two packages. <strong><code>fusion/</code></strong> is a library: arrays in, estimates out; it knows no web, database or environment. <strong><code>app/</code></strong> is a service around it: it stores drives and roads, runs the library on them, and serves slopes. <code>app</code>
imports <code>fusion</code>, never the other way round, and no file imports itself through others; <code>tests/test_layout.py</code> and <code>tests/test_architecture.py</code> hold that, and the other rules on this page.</p>
<h2 id="the-way-of-one-drive-from-upload-to-tile"><a class="self" href="#the-way-of-one-drive-from-upload-to-tile">The way of one drive, from upload to tile</a></h2>
<pre tabindex="0"><code>   POST /v1/drives                       a worker, perhaps on another machine                        GET /tiles/14/8579/5634.mvt
        |                                             |                                                          |
   app/drives  upload, body                    app/drives  worker, process                                 app/map/tiles  front, watch
        |                                             |                                                          |
   app/core    blobs  (the bytes)              fusion      formats -&gt; pipeline -&gt; methods                  memory, stored_tiles, or store (SQL)
        |                                             |                                                          |
   app/drives  intake: row and job,            app/network results: passes and marks                       segments, segment_slopes
               one transaction                        |  one commit: the drive waits                           and the versions of the
        |                                      app/network swap: snapshot -&gt; solve -&gt; publish              squares below (ETag)
        |                                             |                                                          ^
        +------------- queue in PostgreSQL ----------&gt; +---- one commit: slopes, versions; the drive is done ------+
</code></pre>
<ol>
<li><strong>Upload</strong> (<code>app/drives/upload.py</code>). The route checks method and options, then takes the files out of the body as they arrive (<code>app/core/receiving/body.py</code>) and hands them piece by piece to the blob store (<code>app/core/blobs.py</code>): constant
memory, and the limit applies before the body's end. What is no log is refused from its first bytes (<code>first_look.py</code>). Several files that belong together become one zip on the way (<code>parcel.py</code>, <code>bundles.py</code>); what identifies a drive is what its files hold, in any order, gzip or zip. <code>app/drives/intake.py</code> writes the drive's row and its job in <strong>one transaction</strong>; the same bytes again give the drive that is there. The answer is 202.</li>
<li><strong>Worker</strong> (<code>app/drives/worker.py</code>, <code>app/jobs/</code>, queue: procrastinate inside PostgreSQL). It claims the drive and runs <code>app/drives/process.py</code>: read the log, compute positions where it has raw signals (<code>fusion/gnss/</code>), take roads and elevation around it, estimate, say. Progress goes to the row,
from which <code>/v1/drives/{id}/events</code> tells it. A run belongs to a <em>generation</em> of its drive: whoever was deleted or asked for anew meanwhile finds that out when it wants to say something, and discards its result.</li>
<li><strong>Log</strong> (<code>fusion/formats/</code>). The format is recognised by content. Every format yields a <code>DriveLog</code> (<code>fusion/types.py</code>): one table per sensor at its own rate, SI units, NaN where nothing was measured, and what was skipped or repaired.
Several files of one drive are joined (<code>together.py</code>); a phone's inertial sensors are turned into the vehicle's axes, or left out (<code>phones/mounting.py</code>). Where a log has raw signals, <code>fusion/gnss/</code> makes positions of them first (stage <code>positioning</code>; <code>fusion/gnss/positioning.py</code> says which are taken).</li>
<li><strong>Estimate</strong> (<code>fusion/pipeline.py</code>). The roads near the log are projected to a plane around it (<code>fusion/roads/</code>), and the method asked for does its work. <code>profile</code> (<code>fusion/profile/</code>) matches the whole drive
(<code>fusion/matching/drive.py</code>), smooths height and grade along the path, and yields a <code>DriveResult</code>: a track, slopes, a report, and a <strong>pass factor</strong> (<code>fusion/network/pass_factor.py</code>) for each passage over a segment.</li>
<li><strong>Say</strong> (<code>app/network/results.py</code>). One short transaction stores what the drive says (<code>passes.py</code>), decides which of two logs of one drive is heard (<code>twins.py</code>), and <strong>marks</strong> the squares of the map that this touches (<code>marks.py</code>): tiles
of zoom 14 (<code>cells.py</code>). The drive waits, stage <code>publishing</code>.</li>
<li><strong>Solve and swap</strong> (<code>app/network/swap.py</code>, asked for by <code>app/drives/publishing.py</code>). A solver takes marked squares that no other has, reads in one snapshot, takes the part of the network that the changes can reach (<code>fusion/network/window.py</code>) and solves it anew with the library
(<code>solve.py</code>, <code>fusion/network/adjust.py</code>), outside of any lock. Then, in one short transaction: if no other solver has written in those squares since, slopes and verdicts are exchanged, combined with those of methods that yield nothing else (<code>publish.py</code>), the squares in which
anything changed get a new version, and the marks go; else all again with what came. At last it sums old passes of segments that have too many (<code>sums.py</code>). A drive without marks is done, and so is, with a warning, one whose last marks lie in squares that no solver can solve: these stay, are tried ever more
rarely and told in <code>/v1/admin/stats</code>. While drives wait, squares are solved every half minute at most, so that twenty drives over a street cost one solution. <code>settle.py</code> solves squares in
wide windows, in the background or by <code>versant settle</code>. A removed drive goes the same way: <code>cancelled</code> at once, and from then on shown to nobody (<code>IS_SHOWN</code> in <code>app/core/tables</code>), its passes taken back and its log deleted by a job, its row gone when its squares are solved.</li>
<li><strong>Serve</strong> (<code>app/map/</code>). OGC API Features are two rooms: <code>app/map/items/</code> reads what is asked for and finds the items, as text that PostgreSQL writes; <code>app/map/ogc/</code> has the routes, and every document in each form (<code>negotiation.py</code>), as pages too (<code>templates/</code>). Tiles and files read <code>segments</code> and <code>segment_slopes</code> through <code>app/map/store.py</code>; one record, <code>app/map/segment.py</code>, is what SQL fills and every output writes. The versions of the squares below a tile make its ETag: it
answers 304 after one indexed look until something in it changes. Vector tiles have a room of their own, <code>app/map/tiles/</code>: <code>front.py</code> answers what is the address of a tile beyond doubt, past the framework; <code>watch.py</code> keeps the versions of all squares in memory by
one look before every answer (<code>versions.py</code> sums them up for each tile); <code>tiles.py</code> has the tile in memory, fetches it from <code>stored_tiles</code>, or builds it once for all processes; the SQL is in its <code>store.py</code>.</li>
<li><strong>Derive</strong> (<code>app/map/derived/</code>, a chore of the worker). Ways (<code>app/map/ways/</code>: consecutive segments of one OpenStreetMap way) and the pieces that low zooms draw (<code>app/map/drawn/</code>) are made of segments a moment later, <a href="#derived-from-segments">and of nothing else</a>.</li>
</ol>
<p>Without a service the way is shorter: <code>versant fuse</code> (<code>app/cli/fuse.py</code>) reads files, runs steps 3 and 4 for each log, solves all of them together (<code>fusion/results.py</code>), and writes the same records. A notebook does the same by
the names that <code>import fusion</code> offers.</p>
<h2 id="rooms"><a class="self" href="#rooms">Rooms</a></h2>
<p>Library, from the ground up; a room imports only from those named with it (and from the ground).</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>room</th>
<th>for</th>
<th>looks into</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>arrays</code> <code>types</code> <code>signals</code> <code>errors</code> <code>registry</code> <code>frames</code> <code>compiled</code></td>
<td>the ground: what passes between rooms, the tree of errors, things chosen by name, geodesy, compiled loops</td>
<td>-</td>
</tr>
<tr>
<td><code>formats/</code></td>
<td>one file per log format; <code>receiver/</code>: what receivers send, byte by byte</td>
<td>-</td>
</tr>
<tr>
<td><code>gnss/</code></td>
<td>raw signals -&gt; positions: <code>orbits/</code>, <code>corrections.py</code>, <code>measure.py</code> (signals to measurements), <code>error_models/</code>, <code>solvers/</code>, <code>quality/</code> (figures and law tests), <code>positioning.py</code> (by name, from a log)</td>
<td><code>filters</code></td>
</tr>
<tr>
<td><code>filters/</code></td>
<td>the textbook algorithms, free of any model</td>
<td>-</td>
</tr>
<tr>
<td><code>roads/</code></td>
<td>reading OSM; segments as a table, and on a plane with an index</td>
<td>-</td>
</tr>
<tr>
<td><code>terrain/</code></td>
<td>rasters as one surface by priority, triangles, windows of posts</td>
<td><code>roads</code></td>
</tr>
<tr>
<td><code>matching/</code></td>
<td>where on the network a drive went; <code>points/</code>: the surveyed matchers of single positions</td>
<td><code>roads</code></td>
</tr>
<tr>
<td><code>network/</code></td>
<td>the map from all drives: knots, factors, what is believed of roads, drives and elevation models, the joint solution</td>
<td><code>roads</code> <code>filters</code></td>
</tr>
<tr>
<td><code>methods/</code></td>
<td>the estimators: <code>profile/</code>, and the published ones; <code>base.py</code> is the protocol</td>
<td>all above</td>
</tr>
<tr>
<td><code>report.py</code></td>
<td>what is said of a drive whatever the method, and every sentence of warning that no reader or method makes itself</td>
<td><code>formats</code> <code>methods</code> <code>terrain</code></td>
</tr>
<tr>
<td><code>pipeline.py</code></td>
<td>one drive through all of it, and several drives put together</td>
<td>all above</td>
</tr>
<tr>
<td><code>results.py</code>, <code>__init__.py</code></td>
<td>drives solved together as tables with geometries; the names that <code>import fusion</code> offers, each loaded when it is asked for</td>
<td>all above</td>
</tr>
<tr>
<td><code>simulate/</code></td>
<td>synthetic towns and drives with known truth: <code>scene/</code> is data, <code>motion/</code>, <code>receiver/</code>, <code>canyon/</code> (streets that reflect), <code>write/</code> make drives and files of it</td>
<td><code>roads</code> <code>gnss</code> <code>formats</code></td>
</tr>
</tbody>
</table></div>
<p>Service, by subject, from the ground up: a room looks only into rooms above it in this table. Each has its SQL in one place, as text with a name and a reason: <code>store.py</code>, or the file that the statement belongs to.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>room</th>
<th>for</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>core/</code></td>
<td>what every subject uses: settings, database, tables, errors as problem documents, blobs, HTTP; <code>telemetry/</code>: lines of the log, what is counted, traces. Knows no subject</td>
</tr>
<tr>
<td><code>jobs/</code></td>
<td>the queue: what a task is, how a worker runs them, and what becomes of one that is cut off</td>
</tr>
<tr>
<td><code>embedded/</code></td>
<td>the private PostgreSQL + PostGIS of <code>versant up</code>, the demo and the tests</td>
</tr>
<tr>
<td><code>network/</code></td>
<td>passes and their sums, marks, solution, swap, squares and their versions, settling, locks; extracts of the stored roads</td>
</tr>
<tr>
<td><code>terrain/</code> <code>roads/</code></td>
<td>imports of elevation and of roads; the set of rasters and what is left to be renewed by it; regions, and the attic for what was measured on lost roads</td>
</tr>
<tr>
<td><code>changes/</code></td>
<td>what changed since when: moments, versions, the feed; <code>webhooks/</code>: who is told (<a href="/docs/changes">following the map</a>)</td>
</tr>
<tr>
<td><code>map/</code></td>
<td>segments, tiles, OGC API Features (<code>items/</code>: the engine, <code>ogc/</code>: documents and routes), files (<code>outputs/</code>: one file per format; <code>handover/</code>: one per consumer), pictures (<code>slope_picture.py</code> lays out the paper), the style of web maps with its signs and letters (<code>style/</code>; <code>scale.py</code> has the colours of all maps); <code>heights/</code>: of the road at places; figures of the whole map, made by workers and kept (<code>figures.py</code>); <code>ways/</code>, <code>drawn/</code>: what is derived from segments, <code>derived/</code>: how it follows them</td>
</tr>
<tr>
<td><code>exports/</code></td>
<td>every format of the stored map by one registry, the origin that files state, and exports: asked for, made by a worker, fetched, removed</td>
</tr>
<tr>
<td><code>operations/</code></td>
<td>regions and rasters over HTTP; the operator's long work as jobs: planned, approved, carried out</td>
</tr>
<tr>
<td><code>drives/</code></td>
<td>upload -&gt; row and job -&gt; worker -&gt; result, and what a drive yielded (<code>outputs/</code>; over HTTP: <code>parts/</code>); <code>trials/</code>: a drive by another method for a look at it, which writes nothing but its own row</td>
</tr>
<tr>
<td><code>ops/</code></td>
<td>health, metrics, figures for operators (<code>admin/</code>: named queries), kinds of problems</td>
</tr>
<tr>
<td><code>upkeep/</code></td>
<td>backups and their return, and what is wrong with a service: commands of operators, no routes</td>
</tr>
<tr>
<td><code>web/</code></td>
<td>the pages for people: <code>src/</code> in TypeScript, <code>plugins/</code> for the build, <code>built/</code> what the package holds and <code>pages.py</code> serves (<a href="/docs/pages">the pages</a>); they ask the API as any other client</td>
</tr>
<tr>
<td><code>main.py</code></td>
<td>puts settings, routes and middleware together</td>
</tr>
<tr>
<td><code>cli/</code></td>
<td>the command line, each command loaded when it is named</td>
</tr>
<tr>
<td><code>demo/</code></td>
<td>the demonstration: simulated drives through the whole service</td>
</tr>
</tbody>
</table></div>
<p><code>tests/</code> stands as the packages do, with <code>end_to_end/</code> for whole processes and <code>support/</code> for what tests share; <code>benchmarks/</code> measures accuracy and speed, <code>benchmarks/scenes/</code> and <code>benchmarks/experiments/</code> repeat those of the source documents.</p>
<h2 id="to-add"><a class="self" href="#to-add">To add ...</a></h2>
<p>What can be chosen by name stands in a registry; contract tests loop over it, so a new entry is tested by what all others are tested by.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>to add</th>
<th>write</th>
<th>one line in</th>
<th>then</th>
</tr>
</thead>
<tbody>
<tr>
<td>a log format</td>
<td><code>fusion/formats/NAME.py</code>: a class with <code>recognises(head)</code> and <code>read(data, progress)</code> that yields a <code>DriveLog</code></td>
<td><code>fusion/formats/__init__.py</code>, loosest last</td>
<td>a sample in <code>tests/fusion/formats/conftest.py</code>, a maker in <code>benchmarks/reading/logs.py</code></td>
</tr>
<tr>
<td>a warning</td>
<td>a sentence in <code>fusion/report.py</code>, or in the reader or method that finds it out: into <code>report[&quot;warnings&quot;]</code>, and everybody shows it</td>
<td></td>
<td>a case in <code>tests/app/drives/test_trial.py</code>, which holds <code>fuse</code> and service to the same sentences</td>
</tr>
<tr>
<td>a method</td>
<td><code>fusion/methods/NAME.py</code>, or a folder with <code>method.py</code>: a class that follows <code>Method</code> (<code>base.py</code>), its options a pydantic model</td>
<td><code>fusion/methods/__init__.py</code></td>
<td>a section in <a href="/docs/methods">methods.md</a></td>
</tr>
<tr>
<td>a terrain window</td>
<td>a class</td>
<td><code>fusion/terrain/windows.py</code></td>
<td></td>
</tr>
<tr>
<td>a matcher of positions</td>
<td>a class in <code>fusion/published/matchers/</code></td>
<td><code>fusion/published/matchers/__init__.py</code></td>
<td></td>
</tr>
<tr>
<td>a solver of pseudoranges</td>
<td><code>fusion/gnss/solvers/NAME.py</code>: a class that follows <code>Solver</code> (<code>measurements.py</code>)</td>
<td><code>fusion/gnss/__init__.py</code></td>
<td>a row in <code>benchmarks/pseudorange.py</code></td>
</tr>
<tr>
<td>a model of pseudorange errors</td>
<td><code>fusion/gnss/error_models/NAME.py</code></td>
<td><code>fusion/gnss/error_models/__init__.py</code></td>
<td></td>
</tr>
<tr>
<td>a property of segments</td>
<td>a field of <code>Segment</code> in <code>app/map/segment.py</code>, with its SQL, Arrow type and digits</td>
<td>the same line; its title and meaning in <code>app/map/items/collections.py</code></td>
<td>the properties in README</td>
</tr>
<tr>
<td>a property of ways, something that filters compute</td>
<td><code>app/map/items/collections.py</code>, <code>app/map/items/operators.py</code></td>
<td></td>
<td><a href="/docs/items">items.md</a></td>
</tr>
<tr>
<td>an output of segments</td>
<td><code>app/map/outputs/NAME.py</code>, with what stands beside its file (<code>companions</code>)</td>
<td><code>app/map/outputs/__init__.py</code></td>
<td>it is a format of <a href="/docs/exports">exports</a> by itself; its bytes must not depend on a clock</td>
</tr>
<tr>
<td>a file for another program</td>
<td><code>app/map/handover/NAME.py</code>: a class that follows <code>Handover</code> (<code>base.py</code>), whose docstring names the consumer and the grammar</td>
<td><code>app/map/handover/__init__.py</code></td>
<td>a checker of that grammar in <code>tests/app/map/handover/</code>, a row in <a href="/docs/handover">handover.md</a></td>
</tr>
<tr>
<td>a conformance class</td>
<td>its tests in <code>tests/app/map/ogc/test_ats_*.py</code>, named after the abstract tests</td>
<td><code>CONFORMANCE</code> in <code>app/map/ogc/landing.py</code></td>
<td></td>
</tr>
<tr>
<td>a group of routes</td>
<td>a module with a <code>router</code> in its subject's room</td>
<td><code>ROUTERS</code> in <code>app/main.py</code></td>
<td>a test through HTTP</td>
</tr>
<tr>
<td>a command</td>
<td><code>app/cli/NAME.py</code>; what is heavy is imported inside the command</td>
<td><code>COMMANDS</code> in <code>app/cli/__init__.py</code></td>
<td></td>
</tr>
<tr>
<td>a setting</td>
<td>a field with unit, default and a sentence</td>
<td><code>app/core/settings/</code></td>
<td></td>
</tr>
<tr>
<td>a table or column</td>
<td>the class</td>
<td><code>app/core/tables/</code></td>
<td>a migration in <code>migrations/versions/</code></td>
</tr>
<tr>
<td>an event of the log</td>
<td><code>tell(logger, &quot;what happened&quot;, figures)</code>, within <code>about(ids)</code>; never a place</td>
<td></td>
<td>a row in <a href="/docs/operation">operation.md</a></td>
</tr>
<tr>
<td>a figure that is counted</td>
<td>a <code>Measure</code> in <code>app/core/telemetry/measures.py</code></td>
<td><code>MEASURES</code></td>
<td>a panel in <code>.docs/grafana.json</code></td>
</tr>
<tr>
<td>a query for operators</td>
<td>an entry with its columns in <code>app/ops/admin/queries.py</code>, a statement in a store</td>
<td>the same file</td>
<td>a row in <a href="/docs/operation">operation.md</a></td>
</tr>
<tr>
<td>a kind of problem</td>
<td>an error class</td>
<td>the table in <code>app/core/errors.py</code></td>
<td></td>
</tr>
</tbody>
</table></div>
<p><code>PYTHONPATH=. python tests/test_readme.py --write</code> renews the tables of README and of methods.md from the code.</p>
<h2 id="why-it-is-so"><a class="self" href="#why-it-is-so">Why it is so</a></h2>
<p><strong>Drives contribute likelihoods, not slopes.</strong> A slope that a drive has smoothed already holds the prior and the terrain; averaging ten of them counts these ten times, and the result depends on the order of arrival. A pass factor holds
only what was measured, over the road's heights and over what the drive carries along: tilt of the sensor, errors of its heights. The map is the solution of all factors and one prior: any order gives the same, a deleted drive leaves no trace, junctions agree, and sigma stays true with many drives.</p>
<p><strong>A window, not the whole.</strong> One more drive changes slopes noticeably within a few hundred metres. The service solves that window, looks whether slopes at its rim moved, and widens it if they did; <code>versant settle</code> solves everything.</p>
<p><strong>The queue is in the database.</strong> A drive's row and its job commit together, or neither does; there is no second server to lose one of them. Workers on any number of machines take jobs; a job whose worker died is put back. A death counts against a job only while its own computation ran
(<code>app/jobs/computations.py</code>), and after three it is given up.</p>
<p><strong>Marks instead of a lock.</strong> What drives say is only ever stored together with marks of what it touches, and a square is solved from everything that is stored: whoever dies, and in whatever order solvers come, the marks that are left say what is still to be done. Solvers take squares
by advisory locks that end with their connection, and look at the versions of the squares before they write, so two that overlap cannot undo each other. Drives and solvers share the network for milliseconds; imports of roads own it for a tenth of a second at a time, and changes of the
elevation rasters piece by piece: a short transaction names the new set and where heights are to be renewed, then these follow ten thousand segments at a time, computed outside of any lock. Drives of the same hours come one
after the other, since of two logs of one drive each has to see the other.</p>
<p><strong>Who is answered goes first.</strong> API, workers, imports and PostgreSQL often share two cores. What computes in the background stands back (<code>app/core/background.py</code>), on a server of the same machine its connections' processes too; the
API loads no estimator unless options of one are to be checked, draws in a process beside, and looks for cycles of dead objects only when requests have left some (<code>app/core/middleware.py</code>): a look at all objects takes a quarter of a
second, in which nothing is answered. <code>benchmarks/load.py</code> shows what that is worth.</p>
<p><strong>Done without a square.</strong> A drive is done when its slopes are published. One square that cannot be solved, for lack of memory say, would keep all drives through it from ever being done, and whoever waits for them, for the sake of
slopes that are a small part of what they yield. So they are done without it after six solvers in vain, and say so for as long as it lasts: the warning is made from the marks when the drive is read. A removed drive does wait: gone
means that nothing of it is shown.</p>
<p><strong>Changes are noted by triggers.</strong> Drives, solvers, imports, elevation and people with a console change what is shown; who follows the map must miss none of it, so the database itself notes each segment with the number of its transaction (seven percent of the processor time of a first import). What is told ends
where every transaction has ended, and a version names the database whose numbers it counts by (<a href="/docs/changes">following the map</a>). Messages to webhooks are rows that commit with what they tell, and no jobs: a lane would wait for strangers while drives wait for the lane.</p>
<p><strong>Roads stay in memory.</strong> Until an import changes those of a square they are the same (<code>app/network/road_states.py</code>), and reading those of a window took as long as solving it. Every worker keeps the squares that it read last (<code>app/network/cell_roads.py</code>, 200,000 segments, some 20 MB), for drives and solvers; what is driven and published there is asked for each time.</p>
<p><strong>A jury and sums.</strong> A solution reads the newest 48 to 96 passes over a segment and one sum of all others, however many there are (<a href="/docs/network#old-passes">network.md</a>). The passes stay: a sum can be taken apart again, drive by drive, so deletion and reprocessing leave nothing behind. They lie in sixteen parts by a hash of their region, the tile
of zoom 6 around their square, so that a window looks into one or two of them; <code>drive_constants</code> says in which regions a drive has passes. Here a region is that tile: passes of a segment that an import moves into another one are written anew.</p>
<p><strong>Roads change step by step.</strong> An import copies the file's roads beside the stored ones and compares them (<code>app/roads/comparing.py</code>, <code>fusion/roads/changes.py</code>) without a lock: only imports move roads, one at a time. The plan is all that a trial run prints. Then each change is a short
transaction (<code>app/roads/changing.py</code>, <code>steps.py</code>): what comes and what is only called otherwise shares the network; what touches evidence owns it, in pieces measured to take a tenth of a second, with as long a pause after each. A step raises the number of the squares whose roads it changes,
so a drive that was estimated beside it sees that its roads are others and is estimated again, and an import elsewhere repeats nothing; it marks what is to be solved, and names the drives that lost something (<code>touched_drives</code>), which a worker queues as a batch once the import is over.
An import that dies leaves every step whole; the next one finds the rest.</p>
<p><strong>What was measured belongs to the road, not to the number.</strong> A segment that moved by less than the tolerance, or is called or drawn otherwise, keeps its passes: their factors are taken over the knots of the new course by a linear map that keeps grades (<code>fusion/network/transfer.py</code>), and sums are
made anew from them. What does not hold any more goes into an attic (<code>app/roads/retired.py</code>) with the road's nodes and course, and is put back when a road with these comes again, for drives that were not computed anew since; the others are computed once more.</p>
<p><strong>Synchronous database access, one style.</strong> Handlers run in threads, SQL is text with a name and a reason beside the subject that owns it. Another style has to show in a benchmark what it buys. Vector tiles have shown it: a warm tile is a look of
thirty microseconds and bytes from memory, and the way through middlewares, a thread and a session costs ten times as much. So they alone are answered by the event loop itself, on connections that it waits on (<code>app/map/tiles/connections.py</code>). One look with the driver's own cursors took
57 microseconds of the process's time, past them 13; uvloop saves a tenth of the whole.</p>
<p><strong>Versions of squares, seen in any order.</strong> A look asks for squares whose last change has a number (of its transaction) that the snapshot of the look before did not hold. Numbers are given out before transactions end, so &quot;what is above the last number&quot; would miss what ends late; this misses nothing and tells nothing
twice, while an import runs for an hour as well. An epoch (<code>tile_epoch</code>) changes when squares are deleted and in a restored database; then all is read anew, and every tile has a new name. A tile of low zooms goes by <code>drawn_version</code> alone, since what is drawn there follows a moment after the segments: by both it would be built twice.
Of ways nothing tells which squares a change of one reaches, so their tiles are made at each request and named by their content.</p>
<p><strong>A tile is built once.</strong> All who want the same state of a tile wait for the same one; the last of them who leaves cancels the statement. Between processes an advisory lock is held from the look into the table to the row in it. The table is unlogged: what is in it can be built again, and it writes no log beside drives that are published.</p>
<p><strong>Totals in the database.</strong> Workers answer nobody, and lanes come and go. Each process writes what it has counted into a row of its own, so none waits for another, and the API adds the rows up: no port a worker, nothing lost but the last seconds, counters that never fall. Sums are of decimal fractions, since a sum
of binary ones depends on its order and a rounding would look like a restart. Rows of ended processes become one.</p>
<p><strong>Compiled loops by numba.</strong> The library needs loops over a million particles or candidates, and stays Python. Code is compiled once and kept on disk, known to be fresh by the content of every file that it was made from
(<code>fusion/compiled.py</code>).</p>
<p><strong>An embedded PostGIS.</strong> <code>versant up</code>, the demo and the tests start a private cluster on a Unix socket: no test mocks the database, and a newcomer needs one command. No wheel brings PostGIS, so the binaries are the system's.</p>
<p><strong>Said when it is read.</strong> Which other drives contradict a drive, or are the same, changes as they come and go. So its document is completed with these warnings when somebody asks for it (<code>app/drives/documents.py</code>, <code>app/network/rejections.py</code>), and
nothing of it is stored that would be wrong tomorrow.</p>
<p><strong>Unknown is null.</strong> NaN in arrays, NULL in tables, null in JSON; never 0. A sensor that a log does not have is an empty table, and a method says in one sentence what it cannot do without.</p>
<h2 id="derived-from-segments"><a class="self" href="#derived-from-segments">Derived from segments</a></h2>
<p>Two tables hold nothing of their own: <code>ways</code>, a row for each chain of consecutive segments of one OpenStreetMap way, and <code>drawn_pieces</code>, what low zooms draw of roads at four levels. Both can be made from segments at any time, and a test makes them anew after any history and compares.</p>
<p><strong>Lazily.</strong> Whoever changes segments (drives, solvers, imports, a person with SQL) only has them noted, by triggers, with the transaction's number (<code>segment_changes</code>); none of them waits for ways or low zooms. A worker looks once a second (<code>following.py</code>), one statement where nothing has changed, and follows in pieces of half a
second: it reads one snapshot, computes outside of any lock, and writes in one short transaction what came of it together with how far it is (<code>derived_upto</code>). It may die at any moment. While drives wait it follows every five seconds, so that twenty drives over a street cost one way. A command that imports without a worker leaves
all of it to the next one; <code>versant worker</code> that is to end when nothing waits derives first.</p>
<p><strong>Each change once.</strong> Transactions commit in another order than their numbers have. A snapshot has seen all below its <code>pg_snapshot_xmin</code>, so changes are followed up to that, in the order of number and segment. A segment is derived from only once it is followed, and <code>derived_segments</code> says where it was then: when it goes, or goes
elsewhere, the way and the square it left are made anew as well. One derives at a time (an advisory lock that ends with its connection); of two who read the same state, after a lock was lost, the later one finds the <code>turn</code> raised and writes nothing. A dump that is brought to another server is noticed by the row's own <code>xmin</code>, and
everything is followed from the start.</p>
<p><strong>Ways.</strong> Segments know their nodes and not their place in the way, so chains are found by nodes: cut by an extract's edge they are several, and a way that meets itself is one trail through each of its segments. The slope is the mean by length over what drives measured (gaps do not count); <code>measured_share</code> says of how much. Its
sigma is not that of a mean of independent values, since errors of neighbours go together: it is the mean of theirs, which holds even if all err as one, or that of the heights at both ends of a measured stretch (with what slopes and heights say differently, and 2 m of place), whichever is smaller; both are too large rather
than too small. <code>drives</code> are the fewest over anything that was measured. The steepest 20 m go across segments: between nodes the road is taken for straight, since no finer profile is stored, and the steepest stretch inside each segment, which the solution knew, is looked at too.</p>
<p><strong>Pieces.</strong> A square of a level is a tile two zooms below it, and belongs to no other: what changed in it is drawn anew, and 64 squares are the largest tile that shows them.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>level</th>
<th>zooms</th>
<th>square</th>
<th>roads</th>
<th>pieces</th>
</tr>
</thead>
<tbody>
<tr>
<td>12</td>
<td>12, 11</td>
<td>tile of zoom 14</td>
<td>all, each way for itself</td>
<td>300 m</td>
</tr>
<tr>
<td>10</td>
<td>10, 9</td>
<td>zoom 12</td>
<td>tertiary and above, 300 m and more of driven roads that hang together</td>
<td>1.2 km</td>
</tr>
<tr>
<td>8</td>
<td>8, 7</td>
<td>zoom 10</td>
<td>primary and above without ramps, 1.2 km of driven ones</td>
<td>5 km</td>
</tr>
<tr>
<td>6</td>
<td>6, 5</td>
<td>zoom 8</td>
<td>motorways and trunk roads, 5 km of driven ones</td>
<td>20 km</td>
</tr>
</tbody>
</table></div>
<p>Where a square has none of its level's classes, it shows the most important that there is. From level 10 on roads go on across ways, and past side streets that are not drawn, where two of one class meet and no third; those that may be driven one way only are drawn that way, and slopes change their sign where a segment is turned round. A
piece is measured or not: what would be shorter than a tenth of the greatest length goes with what is beside it. Level 8 is made of the pieces of level 10, and 6 of 8, so a change costs one square of each. Lines are as exact as two units of a tile. What a square may take of a compressed tile is bounded (3.6 kB, by number of pieces, slopes
and points): least goes what is important, driven and long; in a town an eighth of the length of its roads, mostly service roads, is not drawn at zoom 12. The order in which squares are drawn is the finest first, but none waits longer than ten seconds for others that still change. Whoever writes pieces raises <code>drawn_version</code> of a
square of zoom 14 inside, and of one in each square into which a changed piece reaches, so that every tile knows; squares that a solver has just then are left for later.</p>
<h2 id="a-hundred-million-passes"><a class="self" href="#a-hundred-million-passes">A hundred million passes</a></h2>
<p>On paper, from what <code>python -m evidence</code> measured (PostgreSQL 15, factors of 1.6 kB: altitudes, Doppler, pitch and force; of altitudes alone 1 kB). A drive of 10 km is 125 passes; a hundred million are 800,000 drives.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>of a pass</th>
<th>bytes</th>
<th>of 100 million</th>
</tr>
</thead>
<tbody>
<tr>
<td>table</td>
<td>1,400 to 1,800</td>
<td>140 to 180 GB</td>
</tr>
<tr>
<td>out of line (factors above 1.9 kB)</td>
<td>650</td>
<td>65 GB</td>
</tr>
<tr>
<td>index by segment and moment, with drive and region</td>
<td>150</td>
<td>15 GB</td>
</tr>
<tr>
<td>key</td>
<td>65</td>
<td>6.5 GB</td>
</tr>
<tr>
<td>index by drive</td>
<td>12 to 20</td>
<td>1.2 to 2 GB</td>
</tr>
<tr>
<td>index of what is in no sum</td>
<td>3.5 to 14</td>
<td>under 1 GB</td>
</tr>
<tr>
<td>its part of <code>drive_constants</code> (30 kB for 10 km)</td>
<td>240</td>
<td>24 GB</td>
</tr>
<tr>
<td><code>pass_sums</code>, 0.7 kB a busy segment, a few times as much until vacuumed</td>
<td></td>
<td>under 5 GB</td>
</tr>
<tr>
<td>log (WAL): appended; summed; a verdict turned</td>
<td>2,400; 1,700; 360</td>
<td>410 GB once</td>
</tr>
</tbody>
</table></div>
<ul>
<li><strong>Growth</strong>: a drive of 10 km adds 320 kB of passes and 30 kB of constants and epochs, and writes 0.3 MB of log when it comes and 0.2 MB once it is summed. A drive a second is 30 GB of tables and 45 GB of log a day.</li>
<li><strong>A solution</strong> reads at most 96 factors a segment, 160 kB, and 0.7 kB of its sum: 4 MB and half a second for two kilometres, 20 MB and about 60 MB of memory for the roads of a drive of 10 km, if all of them are full. It looks into one or two parts, and of these into an index of what is not summed: a few bytes a pass, all in memory.</li>
<li><strong>Vacuum</strong>: a pass is written twice (when it comes, and when it is summed) and never again; verdicts are rows of their own. The second time leaves a dead row behind, whose room the next rows take. Each part is vacuumed by itself: 15 GB at the 40 MB/s that PostgreSQL allows itself by default are six minutes. Set
<code>autovacuum_vacuum_scale_factor</code> to 0.02 for the parts, else two million dead rows come together first.</li>
<li><strong>Backups</strong>: 280 GB are 25 minutes at 200 MB/s for <code>pg_basebackup</code>, an hour for <code>pg_dump</code>; with an archive of the log only what is new is copied.</li>
<li><strong>To tune</strong>: <code>max_wal_size</code> 16 GB (else checkpoints write whole pages again and again), <code>wal_compression</code>, <code>shared_buffers</code> for the indexes of the busy parts (1.4 GB each). <code>ALTER TABLE ... SET (toast_tuple_target = 128)</code> on the parts keeps factors out of line: summing then writes a few hundred bytes instead of 1,700 (not measured), reading looks once more into an index for
each factor. More than sixteen parts help where more than sixteen regions are driven; constants of drives of hours (240 kB an hour, since their settings are stored as one full matrix) before passes do.</li>
</ul>
<h2 id="words"><a class="self" href="#words">Words</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>word</th>
<th>here</th>
</tr>
</thead>
<tbody>
<tr>
<td>segment</td>
<td>a pair of consecutive nodes of a drivable way, in the direction in which the way is drawn</td>
</tr>
<tr>
<td>pass</td>
<td>one uninterrupted stay of a drive on a segment</td>
</tr>
<tr>
<td>factor</td>
<td>what one pass says about the heights along its segment and about its drive's own errors: a small Gaussian likelihood</td>
</tr>
<tr>
<td>nuisance</td>
<td>an unknown of the drive that a factor speaks of: tilt, bias, squat, lag, errors of heights at entry and exit</td>
</tr>
<tr>
<td>knot</td>
<td>a place on a segment at which height and grade are unknowns; between knots the height is a cubic</td>
</tr>
<tr>
<td>jury, sum</td>
<td>the newest passes over a segment, which a solution reads one by one; all others, added up</td>
</tr>
<tr>
<td>region</td>
<td>of passes: the tile of zoom 6 around a segment's square: which part of the passes it is in</td>
</tr>
<tr>
<td>gap</td>
<td>between driven segments: an undriven stretch whose slope follows from both sides. In a log: a stretch without recording, across which nothing is interpolated</td>
</tr>
<tr>
<td>region</td>
<td>of roads: what came from one file and is updated by the next (<code>app/roads/regions.py</code>). Of passes, see above</td>
</tr>
<tr>
<td>attic</td>
<td>where what was measured on roads that are gone waits for them</td>
</tr>
<tr>
<td>window</td>
<td>the part of the network that is solved again; in <code>terrain/</code>, the posts around a segment that a height is taken from</td>
</tr>
<tr>
<td>epoch</td>
<td>one moment of a log laid on one clock</td>
</tr>
<tr>
<td>outage</td>
<td>positions are missing and the other sensors go on; unlike a gap it is bridged</td>
</tr>
<tr>
<td>mount pitch</td>
<td>how far the sensor is tilted in the vehicle, which adds to every pitch</td>
</tr>
<tr>
<td>moment, horizon, version</td>
<td>the number of a transaction; the one below which all have ended; a moment as a text that names its database</td>
</tr>
<tr>
<td>generation</td>
<td>the number of the request to process a drive; an older one's result is discarded</td>
</tr>
</tbody>
</table></div>
`;export{e as default};