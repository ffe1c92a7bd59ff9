var e=`<h1 id="the-model-of-the-network">The model of the network</h1>
<p>Heights of the roads, and what every drive carries along, as one sparse least-squares problem: geodesy's network adjustment. Code: <code>fusion/network/</code>; how a drive becomes factors is <code>fusion/profile/</code> (<a href="/docs/methods">methods.md</a>). Grades
and their sigmas are pure numbers here (0.01 = 1 %), slopes of segments are percent.</p>
<h2 id="unknowns"><a class="self" href="#unknowns">Unknowns</a></h2>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>of</th>
<th>what</th>
<th>number</th>
</tr>
</thead>
<tbody>
<tr>
<td>the map</td>
<td>a height at every node; height and grade at knots at most 20 m apart along every segment (<code>curve.py</code>)</td>
<td>1 a node, 2 a knot</td>
</tr>
<tr>
<td>a drive</td>
<td>mount pitch (one for each setting of the mount), bias of the accelerometer, squat, lag of the altimeter in seconds</td>
<td>at most 4</td>
</tr>
<tr>
<td>half a minute of a drive</td>
<td>error of its positions to the east and to the north, in units of what they state</td>
<td>2</td>
</tr>
<tr>
<td>a drive's pass over a segment</td>
<td>error of each height sensor where it enters and where it leaves</td>
<td>2 a sensor</td>
</tr>
<tr>
<td>all drives</td>
<td>the mean lag of altimeters</td>
<td>1</td>
</tr>
</tbody>
</table></div>
<h2 id="factors"><a class="self" href="#factors">Factors</a></h2>
<ol>
<li><strong>A pass</strong> (<code>pass_factor.py</code>, made in <code>methods/profile/traversals.py</code> and <code>likelihood.py</code>): the Gaussian likelihood of everything that was measured on the pass, over the knots of its segment and the drive's unknowns. What is the pass's alone is integrated out: the way of
the height errors from entry to exit (random walks with the learned rates), the wander of the attitude about its mount (one draw a pass of the learned size, under pitch and force alike), and the <strong>place</strong> of the pass along the road: farther along by so much, heights change by the grade and grades by the bend of the
drive's own smoothed profile. The place errs by one axis of the accuracy that the fixes state: by what changes on the pass alone, and by what <strong>its half minute of the drive has in common</strong>, to the east and to the north. Unknown, it would blur every bend in the mean of many drives without any sigma knowing.</li>
<li><strong>From pass to pass</strong> the height errors walk on: exit and next entry differ by the rate times the time between, and one second. So heights carry as far as the sensor knows them, through segments where nothing else was measured.</li>
<li><strong>The drive's constants</strong> have priors that say next to nothing; never the drive's own posterior. Every pass speaks of them, so a mount is known from the whole drive and counts once.</li>
<li><strong>Nodes agree</strong>: the end of every segment has its node's height, with heavy tails. <strong>Grades walk at random</strong> along segments, and go on at nodes by <code>joints.py</code>; they are small (<code>GRADE_SIGMA</code>).</li>
<li><strong>The level</strong> of all roads that hang together is known to a kilometre, about where the last solution found it: it keeps the equations solvable where nothing speaks of heights, and draws no height towards 0.</li>
<li><strong>The elevation model</strong> (<code>terrain.py</code>): its error is an Ornstein-Uhlenbeck process along the roads, whose size and length are learned where roads were driven. Differences from knot to knot have heavy tails, for models have edges; so have heights where drives
contradict them, and of roads that nobody drove. It is there once, however many drives there are, and so are slopes of methods that lean on it (<code>combine.py</code>): together no surer than the surest, and nothing beside the network's. Bridges and tunnels and what touches them are left out. Where it stands out from itself by 15 m and four of its sigmas over 100 m of driven road (<code>displaced.py</code>), reports say so.</li>
<li><strong>Control points</strong> (<code>control.py</code>): surveyed heights, an equation on the nearest road within 20 m, with heavy tails; those that miss the solution by four sigmas are named.</li>
</ol>
<p>A <strong>slope</strong> is the regression of height on distance over the <em>whole</em> segment, exact for the cubics; <code>driven_share</code> says how much of it was driven. Its variance is that of the solution, and what the place of the map's nodes adds: (ds/dstart)^2 +
(ds/dend)^2 times the square of the node's place, which is nothing where the grade is even, and much on short segments in a bend. <strong>Heights published</strong> are the nodes', so that loops close, with their sigma, on the datum of the drives' altitudes or of control points;
unknown where nothing tells them to <code>KNOWN_SIGMA_M</code>. The <strong>steepest</strong> 20 m are those of the cubics inside.</p>
<h2 id="learned-in-rounds"><a class="self" href="#learned-in-rounds">Learned in rounds</a></h2>
<p>Each of four rounds solves, takes the covariances of the unknowns that share an equation (Takahashi's recursion), and weighs anew:</p>
<ul>
<li><strong>Passes</strong>: with c the chi-square of the pass for each of its measurements, at the solution, and k the <strong>scale of its drive</strong>, the weight is (4 + 1) / (4 + c / k) / k: Student's t with four degrees of freedom. Beyond c = 16 k it falls with 1 / c besides; beyond c = 16 the pass counts as
not heard. k is found from the middle misfit of the drive's passes among ten imaginary ones that fit, then as the t's own scale without those that contradict; never less than 1: a drive that fits worse than it believes of itself weighs less as a whole. (Its own pull on
the solution is not taken off: one that boasts is found out only among several others.)</li>
<li><strong>Walks from pass to pass</strong>: Student's t with two degrees of freedom, and a scale for each drive's sensor: jumps of a height are let go where they happen.</li>
<li><strong>Roughness</strong>: the usual one about each place (<code>cells.py</code>: what lies farther has no part in it, so that a window learns what the whole does) by expectation and maximisation from where the drives' own begin, then how much rougher those of each class of roads are there than the others, shrunk to them; each interval about it by Student's t with three degrees of freedom. <strong>Where nobody drove or measured</strong> (before the first and behind the last place that any pass reaches on the segment)
nothing tells which intervals are even: they have the t's variance, three times its scale squared.</li>
<li><strong>Nodes, control points</strong>: Student's t with two. <strong>The elevation model</strong>: after the first solution, which is without it; edges at once.</li>
</ul>
<p><strong>Lags of altimeters.</strong> Heights that err as slowly as the air's pressure (<code>BAROMETRIC_DRIFT</code>) and state no accuracy are late (a log's own pressures are not: they are a sensor's samples); so are heights in the steps of bicycle computers' files. Heights are put where the vehicle was <code>lag_s</code> before; the solution corrects the lag, and the factors are made
anew until it stands (<code>LAG_ROUNDS</code>). Lags are normal about a mean that all drives share, 1.5 +- 1 s beforehand: where everybody drives the same way only the differences can be seen.</p>
<h2 id="what-a-drive-learns-by-itself"><a class="self" href="#what-a-drive-learns-by-itself">What a drive learns by itself</a></h2>
<p>Noise levels, rates and robust weights are the drive's own (<code>methods/profile/levels.py</code>, <code>noise.py</code>) and stay as they are, so that the order of arrival changes nothing. Three rough steps of EM lead away from any start; then, three times, the <strong>most likely levels</strong> are sought, white ones, rates
of drifts, roughness and the wander of the attitude at once (the gradient of the likelihood from one pass of the smoother, Koopman and Shephard 1992; L-BFGS on logs with weak priors), outliers are weighed down, and states that break with the model are let jump. A measurement with errors of Student's t tells less than one
with Gaussian errors: variances count (nu + 3) / (nu + 1) times, in learning and in factors. On drives drawn from the model all levels come out within 10 % (<code>tests/fusion/profile/test_levels.py</code>). A receiver's heights that seem less noisy than is possible come
out of its filter: levels are then sought from heights eight seconds apart, and the others count as often as they are new (<code>FILTERED</code>, <code>HEIGHTS_APART_S</code>).</p>
<h2 id="which-drives-and-which-part-of-the-network"><a class="self" href="#which-drives-and-which-part-of-the-network">Which drives, and which part of the network</a></h2>
<ul>
<li><strong>The same drive twice</strong> (<code>witnesses.py</code>), or one log in two formats: equal moments of entering segments and equal epochs. It is one witness, and reports say so.</li>
<li><strong>A window</strong> (<code>window.py</code>) of 500 m about what changed is solved, and 300 m published: 99 % of slopes within a tenth of their sigma of the solution of all. <strong>Elsewhere</strong> (<code>elsewhere.py</code>): what a drive's passes outside say of its constants, each alone over a road of which only <code>GRADE_SIGMA</code> is
known: never too much. Gaps that only roads outside can compare wait until all is settled. Sums that are added and taken off, so a deleted drive leaves no trace.</li>
<li><strong>Sums</strong> (<code>sums.py</code>): of the passes over a segment the newest 48 to 96 (<code>JURY</code>) are read as they are; what is older is one sum over the segment's knots. Each of its passes is in it as often as it counted in the solution before it was summed, the drive's own errors integrated out: constants with half of what its other
passes say of them (<code>SHARE_ELSEWHERE</code>), heights with nothing. A sum is a likelihood like any other, judged as a whole by how much worse it fits than it would by itself; where most of the newest passes contradict it, it is let go: a road that was rebuilt is what the newest drives say. <a href="#old-passes">Below</a> what that changes.</li>
<li><strong>Blocks</strong> (<code>blocks.py</code>): interiors are eliminated onto their borders and borders solved together (Helmert), each block a pure function that another process can do; the result is that of one system.</li>
</ul>
<h2 id="old-passes"><a class="self" href="#old-passes">Old passes</a></h2>
<p>If every solution read all passes over its roads, it would take longer with each drive. So a segment with more than 2 <code>JURY</code> of them gets a <strong>sum</strong>, made by the solver that has just published its square, in a short transaction of its own (<code>app/network/condensed.py</code>): whole drives, the oldest first, until at most <code>JURY</code> passes are left. A row of
<code>drive_passes</code> gets its <code>summed_weight</code> (0: rejected) in the transaction in which its part is added to <code>pass_sums</code>; rows of that are only added, and put together by who sums. A drive that goes, says something else or turns out to be there twice is taken off: its parts are computed again from its factors and <code>drive_constants</code>, as they were, and
added with their signs turned. Whoever sums leaves out drives that are being changed just then (<code>SKIP LOCKED</code>), whoever changes one waits for the end of that transaction: each pass is in the jury or in the sum, and whoever dies leaves it where it was. Verdicts stand beside (<code>rejected_passes</code>): turning one rewrites no pass.</p>
<p>What a sum leaves out: errors of heights that a drive carries from segment to segment, and that all passes of a drive share its constants. What is left of a constant's error is so taken for independent from segment to segment, and would be averaged away over them; hence only half of what is said elsewhere is believed, and less of short drives. A pass of the jury
hears of its drive's constants from its summed passes as from passes outside of a window, which is less than they would say beside it. The weight of a pass is what it was when it was summed; so slopes depend on the order of arrival of more than 2 <code>JURY</code> drives, within what the table says.</p>
<p><code>PYTHONPATH=.:benchmarks python -m evidence --most 1000 --without 300</code>: a street of 25 segments, drives with Doppler, pitch, force and altitudes; read and solve the whole of it. Differences are from the solution of all passes, in its sigmas.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>passes over a segment</th>
<th>rows read of each</th>
<th>kB</th>
<th>s</th>
<th>without sums: kB</th>
<th>s</th>
<th>slopes apart, sigmas: median, most</th>
<th>sigmas over theirs</th>
</tr>
</thead>
<tbody>
<tr>
<td>10</td>
<td>10</td>
<td>404</td>
<td>0.04</td>
<td>404</td>
<td>0.05</td>
<td>0</td>
<td>1</td>
</tr>
<tr>
<td>100</td>
<td>48</td>
<td>1,958</td>
<td>0.20</td>
<td>4,076</td>
<td>0.71</td>
<td>0.024, 0.101</td>
<td>0.998 to 1.005</td>
</tr>
<tr>
<td>300</td>
<td>56</td>
<td>2,289</td>
<td>0.26</td>
<td>12,240</td>
<td>5.0</td>
<td>0.023, 0.123</td>
<td>0.998 to 1.004</td>
</tr>
<tr>
<td>1,000</td>
<td>48</td>
<td>1,958</td>
<td>0.28</td>
<td></td>
<td></td>
<td></td>
<td></td>
</tr>
</tbody>
</table></div>
<p>At 7,500 passes, where a longer run was broken off, a solution read the 96 of a full jury and what had come since.</p>
<p>With <code>--jury 24</code> and <code>96</code> instead of 48 a solution takes half and twice as long, and slopes are as near (0.11 sigma): the jury is so large for the sake of verdicts, and so that up to 96 passes nothing changes at all.</p>
<h2 id="constants"><a class="self" href="#constants">Constants</a></h2>
<p>RMSE worse by so much (share within 1.96 sigma, change in points) without or with another value: one drive / ten together, karlsruhe 00, 09 and 10, two seeds and one set of ten, M8; F9P. <code>python benchmarks/ablation.py DATA --constants</code>. As it is: M8 0.559 % (93.9 %) / 0.246 % (91.9 %); F9P 0.337 % (95.3 %) / 0.229 % (93.9 %). &quot;Nothing&quot;: below 0.15 % of the RMSE and 0.35 points.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>constant</th>
<th>value</th>
<th>source</th>
<th>ablation</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>ROUGHNESS_FREEDOM</code></td>
<td>3</td>
<td>tails of changes of grade; tuned on 00 and 09</td>
<td>off: Gauss: +2.9 (0) / -2.1 (+1.4); +3.3 (0) / -15.8 (0)<br>doubled: +1.1 (-0.3) / -1.6 (+0.7); +0.9 (0) / -5.9 (+0.7)</td>
</tr>
<tr>
<td><code>UNSEEN_VARIANCE</code></td>
<td>3</td>
<td>variance of that Student's t over its scale squared</td>
<td>off: 1: -0.1 (+0.3) / 0 (0); -0.2 (+0.3) / 0 (0)</td>
</tr>
<tr>
<td><code>STRUCTURE_FACTOR</code></td>
<td>0.1</td>
<td>bridges and tunnels are built to a design</td>
<td>nothing by any</td>
</tr>
<tr>
<td><code>NODE_SIGMA_M</code></td>
<td>0.2 m</td>
<td>lanes and camber</td>
<td>halved: +0.1 (-0.3) / -0.2 (+0.7); +0.6 (0) / -0.3 (0)<br>doubled: +0.3 (-0.3) / +0.5 (+0.7); 0 (0) / +0.5 (0)</td>
</tr>
<tr>
<td><code>NODE_FREEDOM</code></td>
<td>2</td>
<td>maps join what does not meet</td>
<td>off: Gauss: 0 (0) / 0 (0); +0.1 (0) / -0.1 (-0.7)</td>
</tr>
<tr>
<td><code>GRADE_SIGMA</code></td>
<td>0.2</td>
<td>grades of roads before anything is measured</td>
<td>halved: +0.4 (+0.3) / -0.1 (0); +0.2 (0) / -1.1 (0)<br>doubled: -0.1 (+0.3) / 0 (0); 0 (0) / +0.3 (0)</td>
</tr>
<tr>
<td><code>LEVEL_SIGMA_M</code></td>
<td>1000 m</td>
<td>heights of roads; keeps the equations solvable</td>
<td>nothing by any</td>
</tr>
<tr>
<td><code>PASS_FREEDOM</code></td>
<td>4</td>
<td>tails of whole passes</td>
<td>off: Gauss: +0.1 (+1.0) / +0.2 (+1.4); +0.5 (+1.0) / -0.6 (+1.4)<br>halved: 0 (0) / +0.2 (0); -0.3 (-0.7) / +0.7 (-1.4)<br>doubled: 0 (+0.3) / 0 (+0.7); +0.2 (0) / -0.4 (0)</td>
</tr>
<tr>
<td><code>REJECT_SIGMAS</code></td>
<td>4</td>
<td>beyond this a pass is not heard</td>
<td>off: never: nothing<br>halved: 0 (0) / 0 (0); 0 (0) / -0.2 (0)</td>
</tr>
<tr>
<td><code>SCALE_PRIOR_COUNT</code></td>
<td>10 passes</td>
<td>what holds a drive's scale to 1</td>
<td>nothing by any</td>
</tr>
<tr>
<td><code>WALK_FREEDOM</code></td>
<td>2</td>
<td>fixes jump</td>
<td>off: Gauss: 0 (0) / 0 (0); 0 (0) / +0.1 (+0.7)<br>doubled: 0 (0) / 0 (0); 0 (0) / 0 (+0.7)</td>
</tr>
<tr>
<td><code>WALK_PRIOR_COUNT</code></td>
<td>10 steps</td>
<td>what holds a drive to its own rate</td>
<td>off: never learned: 0 (0) / 0 (0); 0 (0) / 0 (+0.7)<br>halved: nothing</td>
</tr>
<tr>
<td><code>START_SIGMA_M</code></td>
<td>30, 300 m</td>
<td>datums; the pressure of the day</td>
<td>nothing by any</td>
</tr>
<tr>
<td><code>CONSTANT_SIGMA</code></td>
<td>0.3, 0.03, 0.005 s^2/m, 4 s</td>
<td>mount, bias, squat, lag (spec 7)</td>
<td>halved: -0.4 (0) / -1.2 (+1.4); -0.1 (0) / -0.1 (+0.7)<br>doubled: +1.5 (+0.7) / +3.8 (0); +0.6 (+0.3) / +0.6 (0)</td>
</tr>
<tr>
<td><code>LAG_MEAN_S</code>, <code>LAG_SIGMA_S</code></td>
<td>1.5 +- 1 s, 2 s</td>
<td>between none and the three seconds of slow filters</td>
<td><code>LAG_MEAN_S</code> nothing by any<br><code>LAG_SIGMA_S</code> nothing by any</td>
</tr>
<tr>
<td><code>PLACE_SIGMA_M</code> (<code>published</code>)</td>
<td>2 m</td>
<td>where the map's nodes lie</td>
<td>off: 0: 0 (-1.4) / 0 (-5.4); 0 (-1.0) / 0 (-8.8)<br>halved: 0 (-1.0) / 0 (-2.7); 0 (-0.7) / 0 (-4.1)<br>doubled: 0 (+1.4) / 0 (+6.1); 0 (+1.7) / 0 (+4.7)</td>
</tr>
<tr>
<td><code>DEFAULT_SIGMA_M</code>, <code>DEFAULT_LENGTH_M</code></td>
<td>6 m, 300 m</td>
<td>SRTM (spec 7: 6 % over 90 m)</td>
<td><code>DEFAULT_SIGMA_M</code> nothing by any<br><code>DEFAULT_LENGTH_M</code> nothing by any</td>
</tr>
<tr>
<td><code>LONG_LAG_M</code>, <code>PRIOR_PAIRS</code>, <code>SOUND_GRADE</code></td>
<td>100 m, 8, 1.5 %</td>
<td>where and how an elevation model is judged</td>
<td><code>LONG_LAG_M</code> halved: nothing<br><code>LONG_LAG_M</code> doubled: +0.2 (0) / +0.1 (+0.7); +0.1 (+0.7) / 0 (+0.7)<br><code>PRIOR_PAIRS</code> nothing by any<br><code>SOUND_GRADE</code> nothing by any</td>
</tr>
<tr>
<td><code>STEP_FREEDOM</code></td>
<td>2</td>
<td>models have edges</td>
<td>off: Gauss: +0.3 (+0.3) / 0 (0); +0.3 (0) / 0 (0)</td>
</tr>
<tr>
<td><code>WANDER_SIGMA</code></td>
<td>0.5 %</td>
<td>attitude about its mount (spec 7: 0.3 to 0.5 %): where learning begins, <code>LOG_WANDER</code> +- 0.4 in logs</td>
<td>none: +4.5 (-6.1) / +1.0 (-6.1); +2.6 (-0.7) / +0.1 (+1.4)<br>as free as other rates: +0.4 (0) / +1.2 (+1.4); 0 (-0.3) / 0 (0)</td>
</tr>
<tr>
<td><code>WANDER_TAU_S</code></td>
<td>5 s</td>
<td>between the swing of springs and a change of load</td>
<td>halved: +0.2 (+0.3) / -0.3 (+0.7); +0.3 (0) / -0.6 (+0.7)<br>doubled: -0.1 (0) / +0.6 (-0.7); -0.4 (+0.3) / +0.3 (-0.7)</td>
</tr>
<tr>
<td><code>PLACE_BOUNDS_M</code></td>
<td>0.3 to 30 m</td>
<td>stated accuracies are no better than the map; off: no place for a pass; 5 m: <code>PLACE_SIGMA_M</code> of a log that states none</td>
<td>off: 0: -0.6 (-0.3) / -1.4 (+1.4); -0.2 (0) / -0.2 (+0.7)<br>as if nothing were stated: +3.8 (+1.4) / +8.1 (+0.7); +25.1 (-1.4) / +19.7 (-1.4)</td>
</tr>
<tr>
<td><code>ROBUST_INFORMATION_LOSS</code></td>
<td>4/3</td>
<td>Fisher information of Student's t (Lange, Little and Taylor 1989)</td>
<td>off: 1: -0.5 (+0.7) / +4.6 (+0.7); -0.5 (0) / +3.8 (+0.7)</td>
</tr>
<tr>
<td><code>LOG_ROUGHNESS</code></td>
<td>log 3e-5 +- 1.5</td>
<td>flat towns 3e-7, hills 1e-4 1/m (spec 7)</td>
<td>mean ten times less: 0 (+0.3) / -0.1 (0); 0 (0) / -0.2 (0)</td>
</tr>
<tr>
<td><code>ROUGHNESS_PRIOR_COUNT</code></td>
<td>20</td>
<td>imaginary changes of grade about each cell, as large as drives learned; as many of each class, as large as the others'</td>
<td>halved: +0.1 (0) / -0.3 (0); +0.1 (0) / -0.3 (0)<br>doubled: 0 (+0.3) / +0.2 (+0.7); -0.1 (0) / +0.2 (+0.7)</td>
</tr>
<tr>
<td><code>CELL_M</code>, <code>FAR_SHARE</code></td>
<td>250 m, 0.01</td>
<td>roughness is learned place by place, so that windows agree with the whole</td>
<td><code>CELL_M</code> halved: -0.1 (+0.7) / +0.2 (0); -0.1 (0) / +0.4 (+0.7)<br><code>CELL_M</code> doubled: 0 (0) / -0.3 (+0.7); +0.1 (0) / -0.4 (0)<br><code>FAR_SHARE</code> nothing by any</td>
</tr>
<tr>
<td><code>SHARE_ELSEWHERE</code>, <code>USUAL_PASSES</code> (<code>sums.py</code>)</td>
<td>0.5, 40</td>
<td>constants of a drive in a sum</td>
<td>48 of 60 drives in sums, sigmas over those of all drives: 1.00 to 1.05; 1 instead of 0.5: 0.95 to 1.00; 0: up to 1.7. Drives of four passes without <code>USUAL_PASSES</code>: 0.85</td>
</tr>
<tr>
<td><code>PLACE_TAU_S</code>, <code>PLACE_PART_S</code></td>
<td>120, 30 s</td>
<td>positions err for as long as heights (spec 7); over a part the error is one</td>
<td><code>PLACE_TAU_S</code> nothing by any<br><code>PLACE_PART_S</code> halved: +0.2 (0) / -0.4 (+0.7); 0 (0) / +0.2 (+0.7)<br><code>PLACE_PART_S</code> doubled: -0.3 (0) / -0.1 (+1.4); 0 (0) / 0 (0)</td>
</tr>
<tr>
<td><code>FILTERED</code>, <code>HEIGHTS_APART_S</code></td>
<td>1.3, 8 s</td>
<td>heights less noisy than is possible come out of a filter of one to three seconds</td>
<td>of M8 altitudes alone behind a low-pass of 2 s (<code>--log &quot;filtered altitude&quot;</code>; 1.713 %, 89.5 % / 1.298 %, 73.6 %): <code>FILTERED</code> off: -1.6 (-1.3) / -3.4 (-2.7); doubled: +16.1 (+2.4) / +2.0 (+17.6); <code>HEIGHTS_APART_S</code> halved: -1.0 (+0.7) / -2.0 (-0.6); doubled: +1.9 (+0.7) / +0.6 (+0.7). Of altimeters: off: 0 (0) / -15.6 (+1.3): some are taken for filtered receivers</td>
</tr>
<tr>
<td><code>BAROMETRIC_DRIFT</code></td>
<td>0.006 m^2/s</td>
<td>between the air's pressure, 0.001, and good receivers, 0.01</td>
<td>of altimeters without lag (<code>--log altimeter</code>; 0.755 %, 93.6 % / 0.484 %, 89.2 %): off, halved: -1.2 (+1.3) / 0 (0); doubled: +36.9 (-4.1) / +54.6 (-13.5)</td>
</tr>
<tr>
<td><code>DISPLACED_M</code>, <code>DISPLACED_SIGMAS</code></td>
<td>15 m, 4</td>
<td>SRTM is within 16 m in nine of ten places (Rodriguez, Morris and Belz 2006)</td>
<td>said, not weighed</td>
</tr>
<tr>
<td><code>LEAST_HEIGHT_M</code>, <code>LEAST_PRESSURE_HEIGHT_M</code></td>
<td>0.05, 0.1 m</td>
<td>decimetres, heave of the body, place in the lane; gusts</td>
<td>nothing by any; of altimeters <code>LEAST_HEIGHT_M</code> off: 0 (0) / -15.6 (+1.3), as <code>FILTERED</code>; of pressure alone (<code>--log barometer</code>) <code>LEAST_PRESSURE_HEIGHT_M</code> off: +2.4 (-0.3) / 0 (-0.7)</td>
</tr>
<tr>
<td><code>SHARED_START</code></td>
<td>0.8</td>
<td>springs move pitch and force alike</td>
<td>off: 0: 0 (0) / +0.4 (+0.7); 0 (0) / 0 (+0.7)</td>
</tr>
<tr>
<td><code>LOG_RATE_SPREAD</code></td>
<td>1.5</td>
<td>as <code>LOG_SPREAD</code>, of rates</td>
<td>halved: 0 (0) / 0 (0); +0.1 (+0.3) / -0.2 (0)<br>doubled: 0 (0) / 0 (0); 0 (0) / 0 (-0.7)</td>
</tr>
<tr>
<td><code>COMPUTER_STEP_M</code></td>
<td>0.2 m</td>
<td>FIT states altitudes in fifths of a metre</td>
<td>storuman alone: rides in such steps count as late</td>
</tr>
<tr>
<td><code>LOG_SPREAD</code></td>
<td>1.0</td>
<td>receivers differ by ten times</td>
<td>halved: 0 (+0.3) / -0.3 (0); 0 (0) / -0.1 (0)<br>doubled: 0 (0) / +0.1 (+0.7); 0 (0) / 0 (+0.7)</td>
</tr>
<tr>
<td><code>TAIL_SIGMAS</code></td>
<td>2.5</td>
<td>beyond this a measurement counts less while levels are learned</td>
<td>off: never: -0.1 (+0.7) / 0 (+1.4); -0.2 (+0.3) / -0.5 (+0.7)</td>
</tr>
<tr>
<td><code>OUTLIER_SIGMAS</code></td>
<td>4</td>
<td>beyond this it is an outlier</td>
<td>off: never: -0.2 (+0.3) / -0.2 (+1.4); -0.3 (0) / -0.1 (-0.7)</td>
</tr>
<tr>
<td><code>JUMP_SCORE</code></td>
<td>6</td>
<td>a state that breaks with its model has jumped</td>
<td>nothing by any</td>
</tr>
<tr>
<td><code>CORRELATED_WITHIN_S</code></td>
<td>0.8 s</td>
<td>springs swing for about a second</td>
<td>nothing by any</td>
</tr>
<tr>
<td><code>DRIFT_TAU_S</code></td>
<td>120 s</td>
<td>GNSS height errors last minutes</td>
<td>halved: nothing<br>doubled: 0 (0) / -0.1 (+0.7); -0.1 (0) / 0 (-0.7)</td>
</tr>
<tr>
<td><code>ASKEW_SIGMA</code></td>
<td>0.2</td>
<td>grade across a road, by 1 - cosine of the turn</td>
<td>off: 0: +8.6 (+0.3) / +32.8 (+1.4); +14.6 (+1.0) / +22.1 (-0.7)</td>
</tr>
<tr>
<td><code>SLOW_MPS</code></td>
<td>2 m/s</td>
<td>at this speed springs double the variance</td>
<td>off: 0: 0 (+0.3) / +0.4 (0); 0 (+0.3) / +0.3 (+0.7)</td>
</tr>
</tbody>
</table></div>
<p>Not tried: bounds (<code>ROUGHNESS_BOUNDS</code>, <code>SIGMA_BOUNDS_M</code>), what is said rather than believed (<code>KNOWN_SIGMA_M</code>), counts of rounds, and control points, which no benchmark has.</p>
<h2 id="approximations"><a class="self" href="#approximations">Approximations</a></h2>
<ul>
<li>Weights are taken for known: the sigma of a slope holds what is left of the unknowns, not of the weights. Levels are uncertain: factors hold the variances that are to be expected (a level's own sigma from the likelihood's bend).</li>
<li>The response to a lag, to squat and to the place are linear about the drive's own smoothed grade and acceleration; the error of a drive's positions is one within half a minute (<code>PLACE_PART_S</code>) and independent of the next, though it lasts for two (as a chain it gave the same slopes, and a change reached four times as far).</li>
<li>The accelerometer says nothing of squat: the specific force has the acceleration taken off that squat is multiplied with, and their common error would teach a wrong one (measured: phone, 40 drives, 0.35 -&gt; 0.32 %).</li>
<li>Wander is independent from pass to pass (as a chain through the drive it gave the same figures).</li>
</ul>
`;export{e as default};