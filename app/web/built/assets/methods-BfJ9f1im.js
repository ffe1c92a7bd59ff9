var e=`<h1 id="the-methods">The methods</h1>
<p>Every estimator goes by a name (<code>versant fuse --method NAME</code>, <code>POST /v1/drives?method=NAME</code>) and takes options (<code>--option NAME=VALUE</code>, or a JSON object in the query's <code>options</code>). The tables below are made from the
code: <code>PYTHONPATH=. python tests/test_readme.py --write</code> renews them. Equation numbers are those of the source documents.</p>
<h2 id="what-they-are"><a class="self" href="#what-they-are">What they are</a></h2>
<p>Which one? <code>profile</code>, the default, unless you want to compare. The others are published systems, complete and under their names, with the printed forms as options where those differ from what works. They filter forwards, epoch by
epoch, put each epoch on a road, and draw the thesis's least-squares line through the heights that they estimated on a segment (3.4.3); <code>profile</code> smooths the whole drive and gives the network adjustment factors instead of slopes. What
each reaches on surveyed roads, and the experiments of the documents beside ours, stand in <a href="/docs/experiments">experiments.md</a>.</p>
<p>What they share: a log's sensors are laid on one clock (epochs at least <code>period_s</code> apart; in an outage the other sensors keep the pace); what a log lacks is left out, and a method that cannot do without it says so in one sentence; an
outage is bridged by prediction, with a spread that grows, and without positions for two minutes the filter begins anew; fixes that cannot be where the vehicle is are left out, and after three in a row the filter begins anew there. The
sigma of a slope comes from the filter's own spread and from how long its errors hang together, fitted once for each method on many kinds of drives (receivers, roads, the simulated town). The textbook parts (Kalman, extended, unscented,
particle filter, resampling, smoother) stand once, without any model, in <code>fusion/filters/</code>.</p>
<h3 id="profile-a-drive-smoothed-along-its-path-ours-and-the-default"><a class="self" href="#profile-a-drive-smoothed-along-its-path-ours-and-the-default"><code>profile</code>: a drive smoothed along its path, ours and the default</a></h3>
<p>The whole drive at once: matched to a path, smoothed along it with noise levels that the drive itself shows, and handed on as one small likelihood a pass, so that all drives can be solved together. Code: <code>fusion/profile/</code>; the
order of the work is in <code>method.py</code>. How drives are solved together is <code>fusion/network/</code> and has <a href="/docs/network">its own page</a>. Grades and their sigmas are pure numbers here (0.01 = 1 %), slopes of segments are percent.</p>
<h4 id="the-path"><a class="self" href="#the-path">The path</a></h4>
<p><code>path.py</code>. Positions are thinned to one in 0.5 s, and where they are missing for more than 3 s (an outage) the times of the speeds stand in for them, so that the matcher knows how far it is to where the positions come back. The matcher
(<code>fusion/matching/drive.py</code>, a hidden Markov model after Newson and Krumm 2009) gives traversals: stays on one segment in one direction, with the distance s along the path at entry and a probability of being right. Speeds are
Doppler's; the vehicle's own, scaled by the median ratio of the two, fill in.</p>
<p>Where the vehicle was along the path is a least-squares problem of its own, for each connected run, over s at the times of positions and speeds (the second where speeds are known on both sides):</p>
<pre tabindex="0"><code>s(t_i) = matched distance                                 sigma 1 m
s_i+1 - s_i = dt (v_i + v_i+1) / 2                        variance 0.2^2 dt max(dt, 1 s) + corners
(s_i+1 - s_i)/dt_i - (s_i - s_i-1)/dt_i-1 = 0             variance (1 m/s^2)^2 dt max(dt, 1 s) + corners
</code></pre>
<p>A corner of the map is cut short by a vehicle: its variance, (5 m (1 - cos turn))^2, is shared among the steps within 5 m of it; as these are known only once s is, the problem is solved twice. s never falls.</p>
<p>A <em>gap</em> is what was not recorded: times that the log states (<code>DriveLog.gaps_s</code>), and more than 120 s between two knots of s (<code>LONGEST_BRIDGED_GAP_S</code>). Nothing is interpolated across a gap, and a traversal that a stated gap touches yields
no factor. An <em>outage</em> is another thing: positions are missing, the rest goes on.</p>
<h4 id="what-the-sensors-say"><a class="self" href="#what-the-sensors-say">What the sensors say</a></h4>
<p><code>measurements.py</code> makes one table, <code>Measurements</code>, each row at its own time and place. Denser samples are averaged over slots (1 s for heights, 0.5 s for grades). Grades count above 1 m/s and below 60 % only.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>sensor</th>
<th>value</th>
<th>white sigma</th>
</tr>
</thead>
<tbody>
<tr>
<td>altitude</td>
<td>height above the geoid or the ellipsoid, whichever more fixes have: H + D</td>
<td><code>altitude_m</code></td>
</tr>
<tr>
<td>Doppler</td>
<td>-v_down / v, where the course is along the path: G</td>
<td><code>doppler</code> times hypot(s_acc / v, 0.002), s_acc 0.3 m/s where not stated</td>
</tr>
<tr>
<td>pitch</td>
<td>tan(pitch), not while the vehicle moves against its nose: G + M + S a</td>
<td><code>pitch</code> sqrt(1 + (2 m/s / v)^2)</td>
</tr>
<tr>
<td>specific force</td>
<td>tan(asin((f_forward - dv/dt) / g)): G + M + B</td>
<td><code>force</code> sqrt(1 + (2 m/s / v)^2)</td>
</tr>
<tr>
<td>barometer</td>
<td>height in the standard atmosphere: H + P</td>
<td><code>baro_m</code></td>
</tr>
<tr>
<td>elevation model</td>
<td>its height every 25 m of the path, not within 60 m of a bridge or tunnel: H + T</td>
<td>1 m</td>
</tr>
</tbody>
</table></div>
<p>Letters are the states below, a is the acceleration along the path. A crawling vehicle heaves, hence the factor on pitch and force. Every grade has (0.2 (1 - cos(course - path)))^2 added to its variance (<code>white_variance</code>): a
vehicle askew sees some of the grade across. The force says nothing of squat: it has the very acceleration taken off that squat is multiplied with, and their common error would teach a wrong one. Pitch and force ride on the same springs: <code>shared</code> times the pitch beside it is taken off each force (<code>decorrelated</code>), and the force then
speaks of (1 - <code>shared</code>) of what it has in common with the pitch.</p>
<h4 id="the-states-and-how-they-move"><a class="self" href="#the-states-and-how-they-move">The states, and how they move</a></h4>
<p><code>model.py</code>: eight states at every instant at which anything is measured (<code>SmootherEpochs</code>), linear and Gaussian. Between two epochs dt and ds apart:</p>
<pre tabindex="0"><code>H  height            H + G ds                        covariance q [ds^3/3, ds^2/2; ds^2/2, ds]
G  grade             random walk along the road      (the same) + variance of the change of grade at nodes in between
D  GNSS height error D exp(-dt/120 s)                variance r (120 s / 2) (1 - exp(-2 dt / 120 s))
M  mount pitch       constant                        1e-10 / s
B  accelerometer bias over g, S squat (grade per m/s^2): constant
P  barometer's error random walk                     r_P dt
T  DEM's error       T exp(-ds/120 m)                variance dem_m^2 (1 - exp(-2 ds / 120 m))
</code></pre>
<p>q is the roughness of the road, the variance of the grade's change per metre. At a node the grade may change by more, sigma^2 = straight^2 + (turn (1 - cos))^2 + structure^2 (<code>fusion/network/joints.py</code>): 0.001 where a road merely goes on
and 0.003 at a junction, 0.02 and 0.06 for a right angle, 0.03 where a bridge or tunnel begins or ends. Where the path begins anew height and grade are as good as unknown. The smoother is the disturbance form
(<code>fusion/filters/smoother.py</code>): it inverts nothing, and gives the leave-one-out residual of every measurement on the way.</p>
<p>That the mount pitch is a state is what sets <code>profile</code> apart from the filters, which go forwards and need it before they start: they take off one number (<code>fusion/published/epochs/levelling.py</code>).</p>
<h4 id="what-is-learned-from-the-log"><a class="self" href="#what-is-learned-from-the-log">What is learned from the log</a></h4>
<p><code>noise.py</code>, six rounds. Learning starts from what the log states: with v_acc (bounded to 0.3 to 12 m; 4 m where there is none) <code>altitude_m</code> = v_acc / 6, bounded to 0.1 to 1.5 m, and r = 2 v_acc^2 / 120 s, so that D has the stated sigma.
<code>dem_m</code> is the robust spread of the DEM about the altitudes (3 to 100 m) and stays.</p>
<ul>
<li><em>White levels</em> by expectation and maximisation: with r_i the leave-one-out residual, S_i its variance and R_i the measurement's, the expected square of an error is (R_i r_i / S_i)^2 + R_i - R_i^2 / S_i. A sensor's new level is the mean of
these over its measurements, in units of their variance, as if 15 more had come with the level of the start; the start counts only up to a factor of 4 in variance from what the drive shows, since stated accuracies may be wrong by ten times.</li>
<li><em>Robust weights</em>: errors follow Student's t with 5 degrees of freedom, so each variance is divided by (5 + 1) / (5 + r_i^2 / S'_i), S' being what S would be without the weight.</li>
<li><em><code>shared</code></em> by regression of the forces' errors on the pitches' (0 to 0.9).</li>
<li><em>Rates</em> (q, r, r_P) by the likelihood of the whole drive: one step of a parabola through three values, 2.5 times apart, a round. Priors on their logarithms: q about 3e-5 / m with sigma 1.5; r and r_P about their starts with sigma 1.</li>
<li><em>Sudden changes</em>: a phone slides in its holder, a receiver converges anew. For M and D the smoother says how many sigmas speak for a break at each epoch (de Jong and Penzer 1998); the clearest above 6 is let go, by 0.05 (M) or 30 m (D), at
most four of each kind and 5 s apart.</li>
</ul>
<p>At the end what is farther off than 4 sigma is weakened further (its variance grows with the fourth power of the distance), and sensors whose errors within 0.8 s repeat have their variance times (1 + rho) / (1 - rho). Outliers, levels, sudden
changes and what each sensor was worth (the grade's sigma with and without it) are in the drive's report (<code>report.py</code>).</p>
<h4 id="the-track"><a class="self" href="#the-track">The track</a></h4>
<p><code>track.py</code>: one row for each epoch at least 0.475 s after the last, on the path, with H, G and their sigmas, and <code>after_gap</code> where nothing may be drawn across. The measurements that a picture shows (<code>DrawnMeasurements</code>) have M, S a, B
and P taken off; the drift of the altitudes and the DEM's error stay in, as the receiver and the raster said them.</p>
<h4 id="a-pass-as-a-likelihood"><a class="self" href="#a-pass-as-a-likelihood">A pass as a likelihood</a></h4>
<p>Averages of smoothed drives contain the prior once a drive, so a drive does not hand on slopes. It hands on, for each traversal, what was measured there as a Gaussian likelihood (<code>fusion/network/pass_factor.py</code>) over the road's heights and over
what the drive carries along:</p>
<pre tabindex="0"><code>exp(-(square - 2 eta' x + x' Lambda x) / 2)
</code></pre>
<p>x is height and grade at knots, at most 20 m apart (at most 16 intervals a segment), which depend on the segment's length alone, so that all drives speak of the same numbers (<code>fusion/network/curve.py</code>); then mount pitch, bias, squat and the
altimeter's lag, which all passes of the drive share; then the errors of GNSS height and barometer where the pass begins and where it ends. Between two knots at distance d, at share u, the road is Hermite's cubic, which is the mean of a grade
that walks at random given both ends; what it leaves open is added to a measurement's variance:</p>
<pre tabindex="0"><code>heights  q d^3 (u (1 - u))^3 / 3          grades  q d (w - 3 w^2),  w = u (1 - u)
</code></pre>
<p><code>likelihood.py</code> sums the measurements of a pass. What hangs together within the pass only is integrated out: the way that the errors of heights take from entry to exit, random walks with the learned rates, and the wander of the mount about its
mean, of 0.5 % and drawn anew each pass. What the drive carries on stays an unknown of the network, with the network's prior: no factor holds what the drive itself concluded, so nothing counts twice. Terrain heights stay out: the network has
the DEM itself, once. Robust weights are 1 on the mean, but a measurement with errors of Student's t tells less than one with Gaussian errors, so variances count (5 + 3) / (5 + 1) times.</p>
<p>Heights whose error walks as slowly as the air's pressure (by less than 0.03 m^2/s) and that state no accuracy are an altimeter's, and late: they are put where the vehicle was 1.5 s before, and how late they are is an unknown. Where the
solution finds another lag, the factors are made anew (<code>late_by</code> of <code>DriveResult</code>).</p>
<p>A factor counts with the matcher's probability as its weight; below one half there is none. Passes share a mount pitch until the mount moved; one on which it moved has its own.</p>
<p>A drive's own slopes are its factors solved like the network's, alone (<code>adjusted_slopes</code> in <code>method.py</code>).</p>
<h3 id="all-drives-together"><a class="self" href="#all-drives-together">All drives together</a></h3>
<p>Heights of the roads and what every drive carries along, as one sparse least-squares problem: <a href="/docs/network">the model of the network</a>, with its unknowns, factors, what is learned and what is approximated. Only <code>profile</code> gives factors; slopes of
the other methods are averaged with the result by inverse variance (<code>combine.py</code>). <code>versant fuse</code> with several logs solves all roads around them at once, without a database (<code>solve_network</code> in <code>fusion/pipeline.py</code>).</p>
<p>A gap in the network, undriven segments on a way of at most 200 m between two driven nodes (<code>window.py</code>), is solved as well: its slope follows from the roads on both sides, and gives way to anything measured.</p>
<p>How updates grow with the number of drives: <code>python benchmarks/adjustment.py</code>. How near the slopes come, and how true their sigmas are: <code>python benchmarks/slope_accuracy.py</code>, <code>python benchmarks/calibration.py</code>, and
<a href="/docs/experiments">experiments.md</a>. What each constant is worth: <code>python benchmarks/ablation.py --constants</code>.</p>
<h3 id="particle-al-assaad-2020"><a class="self" href="#particle-al-assaad-2020"><code>particle</code>: Al Assaad 2020</a></h3>
<p>Nine states, acceleration, velocity and position along east, north and up (2.1)-(2.6), corrected at each epoch by GNSS position (2.7), acceleration (2.10), in chapter 3 pitch (3.13), the matched road (2.13, 2.26-2.31) and the terrain's
height under it (2.16), in this order. <code>variant=ch2</code> leaves the pitch out and takes the terrain by triangles (2.33-2.34); <code>variant=ch3</code>, the default, takes pitch and the plane through the posts around the whole segment (FGA, 3.1-3.12).</p>
<ul>
<li>Ours, and optional: velocity as a measurement (<code>doppler</code>; the thesis has positions only), the optimal importance density for the sensors that are linear (<code>proposal</code>; the thesis draws from the dynamics), the pitch sensor's mount levelled
before filtering (<code>level_pitch</code>), thinning of errors that hang together (<code>*_correlation_*</code>).</li>
<li><code>discretisation</code>: the position row as printed, or with the a dt^2/2 that it lacks.</li>
<li>Misprints put right: the logarithm of the likelihood has its -1/2 (2.23), angles differ on the circle (2.29, 2.38), (2.30) is a covariance and R of the map is added to it, so that it cannot collapse; the accelerometer's gravity is taken off.</li>
<li><code>filter</code>: <code>sir</code> is the cloud. <code>kf</code> and <code>ekf</code> are the Kalman filters of the background chapter (1.33-1.37) on the same states and measurements; <code>kf</code> takes what is linear only. The model is so nearly Gaussian that <code>ekf</code> gives the cloud's answer
in a small part of its time: <a href="/docs/cheap_filter">how near, and how fast</a>.</li>
<li><code>dem_min_quality</code>: posts that fewer ASTER scenes saw are left out. The quality layer <code>X_num.tif</code> is found beside <code>X_dem.tif</code>.</li>
<li>The report has the share of matched epochs, the share resampled, the mean N_eff, and what the mount is. The same seed gives the same numbers on any number of threads. <a href="/docs/particle">Speed, and what bounds it</a>.</li>
</ul>
<h3 id="ukf-dem-the-filter-that-al-assaad-compares-with"><a class="self" href="#ukf-dem-the-filter-that-al-assaad-compares-with"><code>ukf-dem</code>: the filter that Al Assaad compares with</a></h3>
<p>The same states in an unscented filter over GNSS positions, map and triangulated terrain, without inertial sensors; the thesis describes it in a few sentences only. Process noises are ours, chosen for positions alone. It follows the
receiver's slow height errors, so its slopes are far worse than those of filters that have a pitch or Doppler velocity, and its sigmas say so.</p>
<h3 id="odometer-map-lahrech-boucher-choquel-noyer-2005"><a class="self" href="#odometer-map-lahrech-boucher-choquel-noyer-2005"><code>odometer-map</code>: Lahrech, Boucher, Choquel, Noyer 2005</a></h3>
<p>An extended Kalman filter of nine states. While there is a fix it alone corrects (9); without one the rotations of the rear wheels (3)-(5), (10), then the matched road (11)-(12); without an acceptable match the filter runs open loop.
<code>policy=always</code> fuses everything at each epoch instead, velocity included.</p>
<ul>
<li>Wheels are cumulative rotations (<code>wheel_left_rad</code>, <code>wheel_right_rad</code>) with <code>track_width_m</code>, radii, ticks and error shares as options; a single speed signal (<code>odo_speed_mps</code>) serves as well, with turns from the gyroscope or yaw
(<code>inertial_turns</code>). Rotations over a step depend on the heading before and after it; the heading before is remembered apart, with its variance, also while the vehicle stands, where a velocity has no direction and the Jacobian would be singular.</li>
<li><code>map_correction</code>: the paper corrects by the matched point as a whole; along a straight road that point lies where the filter already believes to be, and taking it for a measurement makes the filter too sure. The default takes what the road says,
the position across it and the direction; <code>point</code> is the paper's. <code>map_step_m=5</code> is the paper's map of points.</li>
<li>The threshold of a match, which the paper does not print, is that of 95 % of a chi-square with three degrees of freedom.</li>
<li>The paper has no measurement of height in an outage; the spread of the climb is bounded by what grades roads have (<code>road_grade_sigma</code>).</li>
</ul>
<h3 id="gps-ins-kf-gps-ins-ekf-gps-ins-ukf-saadaoui-2011"><a class="self" href="#gps-ins-kf-gps-ins-ekf-gps-ins-ukf-saadaoui-2011"><code>gps-ins-kf</code>, <code>gps-ins-ekf</code>, <code>gps-ins-ukf</code>: Saadaoui 2011</a></h3>
<p>Position by GPS, speed and heading by an INS as command. The thesis prints forms that cannot work; they are options, and what they do stands in <a href="/docs/experiments">experiments.md</a>: the command with the heading in place of its components
(<code>command_form</code>), the innovation without the measurement (<code>innovation</code>), the Jacobian with sine and cosine exchanged (<code>jacobian</code>), <code>alpha</code> = 1e3, sigma points not drawn anew after the process noise (<code>redraw</code>).</p>
<ul>
<li><code>heading</code>: a measurement of the third state (default), a value that overwrites it (with <code>heading_reset</code>, its variance and covariances too), or a command, which leaves two states.</li>
<li>What the INS is in a log: speed by Doppler, in an outage by the vehicle's own signal; heading by yaw turned to the course (<code>align_heading</code>), else by the gyroscope, else by the Doppler course. A log of positions alone is refused.</li>
<li>The thesis is two-dimensional. The height is ours: a scalar filter whose command is the climb (pitch times speed and vertical Doppler velocity, weighted by their variances) and whose measurement is the altitude, or the terrain's where
the log has none.</li>
</ul>
<h3 id="raw-dem"><a class="self" href="#raw-dem"><code>raw</code>, <code>dem</code></a></h3>
<p>Baselines: a line through the altitudes as logged, and the terrain's heights at a segment's ends, which is what every tool without drives does.</p>
<h2 id="options"><a class="self" href="#options">Options</a></h2>
<details><summary>Options of every method</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>gnss</code></td>
<td><code>auto</code></td>
<td>auto, receiver, ls, wls, ekf, pf, jms-gmm, rbpf-dpm, one-sided</td>
<td>How positions are computed; all but receiver and auto need raw pseudoranges.</td>
</tr>
<tr>
<td><code>gnss_options</code></td>
<td><code>{}</code></td>
<td></td>
<td>Options of that positioning, by name.</td>
</tr>
<tr>
<td><code>columns</code></td>
<td><code>{}</code></td>
<td></td>
<td>Columns of a CSV by other names: Versant's name -&gt; the header's.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`profile\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>altitude</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use GNSS altitudes.</td>
</tr>
<tr>
<td><code>doppler</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use Doppler vertical velocity over ground speed.</td>
</tr>
<tr>
<td><code>pitch</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use the pitch of an attitude sensor.</td>
</tr>
<tr>
<td><code>force</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use the accelerometer's forward axis beyond the change of speed.</td>
</tr>
<tr>
<td><code>barometer</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use pressure.</td>
</tr>
<tr>
<td><code>dem</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use the elevation model, away from bridges and tunnels.</td>
</tr>
<tr>
<td><code>match_radius_m</code></td>
<td><code>50</code></td>
<td>&gt; 5, ≤ 200</td>
<td>How far from a road a position may lie, m.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`particle\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s; samples between them are averaged (thesis: 1).</td>
</tr>
<tr>
<td><code>discretisation</code></td>
<td><code>thesis</code></td>
<td>thesis, exact</td>
<td>Position row as printed (2.1), or with the a dt^2/2 of constant acceleration.</td>
</tr>
<tr>
<td><code>match_gate</code></td>
<td><code>2.55</code></td>
<td>&gt; 0</td>
<td>Largest Mahalanobis distance of a map match (thesis: 2.55).</td>
</tr>
<tr>
<td><code>antenna_height_m</code></td>
<td><code>1.55</code></td>
<td>≥ 0, ≤ 10</td>
<td>Antenna above the road, m (thesis: 1.55).</td>
</tr>
<tr>
<td><code>doppler</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Use velocity, Doppler or else the fixes' own rate of change; the thesis uses none.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>3</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs (thesis: 3; its experiment 4).</td>
</tr>
<tr>
<td><code>min_speed_mps</code></td>
<td><code>1</code></td>
<td>≥ 0</td>
<td>Below this speed pitch and heading say nothing, m/s.</td>
</tr>
<tr>
<td><code>sigma_acc_mps2</code></td>
<td><code>1.2</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal acceleration, m/s2 per root second.</td>
</tr>
<tr>
<td><code>sigma_vel_mps</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal velocity, m/s per root second.</td>
</tr>
<tr>
<td><code>sigma_pos_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal position, m per root second.</td>
</tr>
<tr>
<td><code>sigma_acc_up_mps2</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Process noise of vertical acceleration, m/s2 per root second.</td>
</tr>
<tr>
<td><code>sigma_vel_up_mps</code></td>
<td><code>0.1</code></td>
<td>&gt; 0</td>
<td>Process noise of vertical velocity, m/s per root second.</td>
</tr>
<tr>
<td><code>sigma_pos_up_m</code></td>
<td><code>0.05</code></td>
<td>&gt; 0</td>
<td>Process noise of altitude, m per root second.</td>
</tr>
<tr>
<td><code>gnss_h_sigma_m</code></td>
<td><code>2.5</code></td>
<td>&gt; 0</td>
<td>Horizontal accuracy (2-D) of a log that states none, m.</td>
</tr>
<tr>
<td><code>gnss_v_sigma_m</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Vertical accuracy of a log that states none, m.</td>
</tr>
<tr>
<td><code>gnss_correlation_s</code></td>
<td><code>2</code></td>
<td>≥ 0</td>
<td>GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>doppler_sigma_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Velocity accuracy of a log that states none, m/s.</td>
</tr>
<tr>
<td><code>rate_sigma_mps</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Best accuracy of a velocity taken from the fixes' rate of change, m/s; scatter widens it.</td>
</tr>
<tr>
<td><code>start_altitude_sigma_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Spread of altitude in a new state, m: the receiver's own datum is kept, slopes need no other.</td>
</tr>
<tr>
<td><code>map_sigma_m</code></td>
<td><code>4</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's position, lane offset included, m.</td>
</tr>
<tr>
<td><code>map_sigma_rad</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's direction, rad.</td>
</tr>
<tr>
<td><code>level_pitch</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Take the pitch sensor's mount off before filtering.</td>
</tr>
<tr>
<td><code>acc_sigma_mps2</code></td>
<td><code>0.3</code></td>
<td>&gt; 0</td>
<td>Accuracy of acceleration, m/s2.</td>
</tr>
<tr>
<td><code>pitch_sigma_rad</code></td>
<td><code>0.0095</code></td>
<td>&gt; 0</td>
<td>Body motion on the suspension, added to the sensor's accuracy, rad.</td>
</tr>
<tr>
<td><code>pitch_correlation_s</code></td>
<td><code>0.3</code></td>
<td>≥ 0</td>
<td>Body motion hangs together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>dem_sigma_m</code></td>
<td><code>6</code></td>
<td>&gt; 0</td>
<td>Accuracy of the terrain's height, m (thesis: 6 World 30, 12.6 ASTER).</td>
</tr>
<tr>
<td><code>dem_correlation_m</code></td>
<td><code>300</code></td>
<td>≥ 0</td>
<td>Terrain errors hang together this far, m: an epoch counts for dx / (dx + 2 L).</td>
</tr>
<tr>
<td><code>dem_min_quality</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 200</td>
<td>Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from other sources, 0 keeps all.</td>
</tr>
<tr>
<td><code>variant</code></td>
<td><code>ch3</code></td>
<td>ch2, ch3</td>
<td>Chapter 2: GNSS, acceleration, map, terrain by triangles. Chapter 3: pitch and windows as well.</td>
</tr>
<tr>
<td><code>filter</code></td>
<td><code>sir</code></td>
<td>sir, ekf, kf</td>
<td>Particles (thesis), its extended Kalman filter, which gives the same slopes in a fraction of the time, or its Kalman filter, which can use neither pitch nor the direction of roads.</td>
</tr>
<tr>
<td><code>particles</code></td>
<td><code>100000</code></td>
<td>≥ 100, ≤ 10000000</td>
<td>Number of particles (thesis: 100,000).</td>
</tr>
<tr>
<td><code>seed</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 2147483647</td>
<td>Seed of the random draws; the same seed gives the same result.</td>
</tr>
<tr>
<td><code>proposal</code></td>
<td><code>optimal</code></td>
<td>optimal, transition</td>
<td>Importance density: the optimal one for the linear sensors, or the dynamics alone (thesis).</td>
</tr>
<tr>
<td><code>resampling</code></td>
<td><code>multinomial</code></td>
<td>multinomial, residual, stratified, systematic</td>
<td>Resampling scheme (thesis: multinomial).</td>
</tr>
<tr>
<td><code>resampling_trigger</code></td>
<td><code>n_eff</code></td>
<td>n_eff, entropy, never</td>
<td>What makes the filter resample: n_eff, entropy, or never, which is SIS (thesis: n_eff).</td>
</tr>
<tr>
<td><code>trigger_threshold</code></td>
<td></td>
<td>&gt; 0</td>
<td>Threshold of the trigger; by default n_eff 2/3 of the particles (thesis), entropy 0.2 nat.</td>
</tr>
<tr>
<td><code>dem_window</code></td>
<td></td>
<td>tin, adjacent, full, hollow</td>
<td>Selection of terrain points; by default the variant's: ch2 tin, ch3 adjacent.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`odometer-map\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s; samples between them are averaged (thesis: 1).</td>
</tr>
<tr>
<td><code>discretisation</code></td>
<td><code>exact</code></td>
<td>thesis, exact</td>
<td>Position row as printed (1), or with the a dt^2/2 of constant acceleration; wheels measure v_k dt (thesis) or the mean velocity of the step.</td>
</tr>
<tr>
<td><code>match_gate</code></td>
<td><code>2.796</code></td>
<td>&gt; 0</td>
<td>Largest Mahalanobis distance of a map match: 95 % of chi-square with 3 degrees of freedom.</td>
</tr>
<tr>
<td><code>antenna_height_m</code></td>
<td><code>1.55</code></td>
<td>≥ 0, ≤ 10</td>
<td>Antenna above the road, m (thesis: 1.55).</td>
</tr>
<tr>
<td><code>doppler</code></td>
<td><code>false</code></td>
<td>true, false</td>
<td>Use velocity, Doppler or else the fixes' own rate of change; by default with policy always, and not with the paper's, which is position only.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>3</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs (thesis: 3; its experiment 4).</td>
</tr>
<tr>
<td><code>min_speed_mps</code></td>
<td><code>1</code></td>
<td>≥ 0</td>
<td>Below this speed pitch and heading say nothing, m/s.</td>
</tr>
<tr>
<td><code>sigma_acc_mps2</code></td>
<td><code>1.2</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal acceleration, m/s2 per root second.</td>
</tr>
<tr>
<td><code>sigma_vel_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal velocity, m/s per root second.</td>
</tr>
<tr>
<td><code>sigma_pos_m</code></td>
<td><code>0.1</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal position, m per root second.</td>
</tr>
<tr>
<td><code>sigma_acc_up_mps2</code></td>
<td><code>0.005</code></td>
<td>&gt; 0</td>
<td>Process noise of vertical acceleration, m/s2 per root second.</td>
</tr>
<tr>
<td><code>sigma_vel_up_mps</code></td>
<td><code>0.3</code></td>
<td>&gt; 0</td>
<td>Process noise of vertical velocity, m/s per root second.</td>
</tr>
<tr>
<td><code>sigma_pos_up_m</code></td>
<td><code>0.05</code></td>
<td>&gt; 0</td>
<td>Process noise of altitude, m per root second.</td>
</tr>
<tr>
<td><code>gnss_h_sigma_m</code></td>
<td><code>2.5</code></td>
<td>&gt; 0</td>
<td>Horizontal accuracy (2-D) of a log that states none, m.</td>
</tr>
<tr>
<td><code>gnss_v_sigma_m</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Vertical accuracy of a log that states none, m.</td>
</tr>
<tr>
<td><code>gnss_correlation_s</code></td>
<td><code>1</code></td>
<td>≥ 0</td>
<td>GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>doppler_sigma_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Velocity accuracy of a log that states none, m/s.</td>
</tr>
<tr>
<td><code>rate_sigma_mps</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Best accuracy of a velocity taken from the fixes' rate of change, m/s; scatter widens it.</td>
</tr>
<tr>
<td><code>start_altitude_sigma_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Spread of altitude in a new state, m: the receiver's own datum is kept, slopes need no other.</td>
</tr>
<tr>
<td><code>map_sigma_m</code></td>
<td><code>4</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's position, lane offset included, m.</td>
</tr>
<tr>
<td><code>map_sigma_rad</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's direction, rad.</td>
</tr>
<tr>
<td><code>dem_sigma_m</code></td>
<td><code>6</code></td>
<td>&gt; 0</td>
<td>Accuracy of the terrain's height, m (thesis: 6 World 30, 12.6 ASTER).</td>
</tr>
<tr>
<td><code>dem_correlation_m</code></td>
<td><code>300</code></td>
<td>≥ 0</td>
<td>Terrain errors hang together this far, m: an epoch counts for dx / (dx + 2 L).</td>
</tr>
<tr>
<td><code>dem_min_quality</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 200</td>
<td>Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from other sources, 0 keeps all.</td>
</tr>
<tr>
<td><code>policy</code></td>
<td><code>paper</code></td>
<td>paper, always</td>
<td>GNSS alone while there is a fix, wheels and map without (paper), or everything at each epoch.</td>
</tr>
<tr>
<td><code>road_grade_sigma</code></td>
<td><code>0.05</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Grade of roads, one sigma, rise over run: bounds the climb where nothing measures height (paper: none).</td>
</tr>
<tr>
<td><code>track_width_m</code></td>
<td><code>1.5</code></td>
<td>≥ 0.3, ≤ 4</td>
<td>Distance between the rear wheels' contact points, m.</td>
</tr>
<tr>
<td><code>wheel_radius_left_m</code></td>
<td><code>0.3</code></td>
<td>≥ 0.05, ≤ 1.5</td>
<td>Radius that the left rear wheel rolls on, m.</td>
</tr>
<tr>
<td><code>wheel_radius_right_m</code></td>
<td><code>0.3</code></td>
<td>≥ 0.05, ≤ 1.5</td>
<td>Radius that the right rear wheel rolls on, m.</td>
</tr>
<tr>
<td><code>wheel_ticks_per_turn</code></td>
<td><code>96</code></td>
<td>≥ 0, ≤ 100000</td>
<td>Ticks that a turn of a wheel counts; 0 for readings without steps.</td>
</tr>
<tr>
<td><code>wheel_error_share</code></td>
<td><code>0.1</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Error of what both wheels, or a speed signal, measure over an epoch, as a share of it, white (paper: &quot;reliability 90 %&quot;).</td>
</tr>
<tr>
<td><code>wheel_each_error_share</code></td>
<td><code>0.01</code></td>
<td>&gt; 0, ≤ 1</td>
<td>The like that each wheel has for itself, white.</td>
</tr>
<tr>
<td><code>calibrate</code></td>
<td><code>false</code></td>
<td>true, false</td>
<td>Estimate lasting errors of the radii, or of a speed signal, along the drive; by default with policy always, and not with the paper's.</td>
</tr>
<tr>
<td><code>wheel_scale_sigma</code></td>
<td><code>0.05</code></td>
<td>≥ 0, ≤ 0.5</td>
<td>Lasting error that both radii or a speed signal may have, a share.</td>
</tr>
<tr>
<td><code>wheel_balance_sigma</code></td>
<td><code>0.005</code></td>
<td>≥ 0, ≤ 0.5</td>
<td>Lasting error that each radius may have for itself, a share.</td>
</tr>
<tr>
<td><code>speed_sigma_mps</code></td>
<td><code>0.1</code></td>
<td>&gt; 0, ≤ 10</td>
<td>White noise of a speed signal, m/s.</td>
</tr>
<tr>
<td><code>inertial_turns</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Where the log has a speed signal but not two wheels, turns by its gyroscope or yaw (paper: none).</td>
</tr>
<tr>
<td><code>match_within_m</code></td>
<td><code>50</code></td>
<td>&gt; 0</td>
<td>No map match where the position's sigma exceeds this, m: any road would do.</td>
</tr>
<tr>
<td><code>map_correction</code></td>
<td><code>line</code></td>
<td>line, point</td>
<td>What a matched road says: position across it and direction, or the matched point as a whole (paper), along the road too.</td>
</tr>
<tr>
<td><code>map_step_m</code></td>
<td></td>
<td>&gt; 0.1, ≤ 100</td>
<td>Spacing of a map made of points, m (paper: 5); by default exact.</td>
</tr>
<tr>
<td><code>dem</code></td>
<td><code>missing</code></td>
<td>missing, always, never</td>
<td>Use the terrain's heights: where the log has no altitude, always, or never (paper).</td>
</tr>
<tr>
<td><code>dem_window</code></td>
<td><code>adjacent</code></td>
<td>tin, adjacent, full, hollow</td>
<td>Selection of terrain points.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`gps-ins-kf\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>dem_sigma_m</code></td>
<td><code>6</code></td>
<td>&gt; 0</td>
<td>Accuracy of the terrain's height, m (thesis: 6 World 30, 12.6 ASTER).</td>
</tr>
<tr>
<td><code>dem_correlation_m</code></td>
<td><code>300</code></td>
<td>≥ 0</td>
<td>Terrain errors hang together this far, m: an epoch counts for dx / (dx + 2 L).</td>
</tr>
<tr>
<td><code>dem_min_quality</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 200</td>
<td>Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from other sources, 0 keeps all.</td>
</tr>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s; samples between them are averaged (thesis: 1).</td>
</tr>
<tr>
<td><code>command_at</code></td>
<td><code>midpoint</code></td>
<td>midpoint, start</td>
<td>Speed and heading of a step: mean of its two ends, or those at its start (thesis).</td>
</tr>
<tr>
<td><code>gnss_sigma_m</code></td>
<td><code>12.5</code></td>
<td>&gt; 0, ≤ 1000</td>
<td>Accuracy of a position per axis where the log states none, m (thesis: 10 to 15).</td>
</tr>
<tr>
<td><code>fix_correlation_s</code></td>
<td><code>5</code></td>
<td>≥ 0, ≤ 1000</td>
<td>GNSS position errors hang together this long, s: a fix counts for dt / (dt + 2 tau) (thesis: 0).</td>
</tr>
<tr>
<td><code>process_sigma_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 100</td>
<td>Process noise of position per axis, m per root second (thesis: 0.5).</td>
</tr>
<tr>
<td><code>drift_share</code></td>
<td><code>0.01</code></td>
<td>≥ 0, ≤ 1</td>
<td>Spread that dead reckoning adds in an outage, as a share of the way since the last fix (thesis: 0).</td>
</tr>
<tr>
<td><code>heading_sigma_rad</code></td>
<td><code>0.05</code></td>
<td>&gt; 0, ≤ 3.2</td>
<td>Accuracy of the heading where the log states none, rad.</td>
</tr>
<tr>
<td><code>align_heading</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Turn the yaw sensor to the course over the whole drive before filtering.</td>
</tr>
<tr>
<td><code>hold_s</code></td>
<td><code>5</code></td>
<td>≥ 0, ≤ 60</td>
<td>How long the last speed and heading stand in for missing ones, s; widened with their age.</td>
</tr>
<tr>
<td><code>gate_probability</code></td>
<td><code>0.999</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Share of good fixes that the innovation gate lets pass (chi-square); 1 takes every fix (thesis).</td>
</tr>
<tr>
<td><code>restart_after</code></td>
<td><code>3</code></td>
<td>≥ 1, ≤ 1000</td>
<td>Fixes rejected in a row after which the filter starts anew at the last.</td>
</tr>
<tr>
<td><code>min_speed_mps</code></td>
<td><code>1</code></td>
<td>≥ 0, ≤ 20</td>
<td>Below this speed pitch and course say nothing, m/s.</td>
</tr>
<tr>
<td><code>match_gate</code></td>
<td><code>2.55</code></td>
<td>&gt; 0</td>
<td>Largest Mahalanobis distance of a map match.</td>
</tr>
<tr>
<td><code>map_sigma_m</code></td>
<td><code>4</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's position, lane offset included, m.</td>
</tr>
<tr>
<td><code>map_sigma_rad</code></td>
<td><code>0.3</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's direction, rad.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>3</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs.</td>
</tr>
<tr>
<td><code>height</code></td>
<td><code>gnss</code></td>
<td>gnss, dem</td>
<td>What measures the height: GNSS altitude (the DEM where the log has none), or the DEM.</td>
</tr>
<tr>
<td><code>climb</code></td>
<td><code>all</code></td>
<td>all, pitch, doppler, none</td>
<td>Command of the height: pitch times speed and vertical Doppler velocity, one of them, or none.</td>
</tr>
<tr>
<td><code>level_pitch</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Take the pitch sensor's mount off before filtering.</td>
</tr>
<tr>
<td><code>pitch_sigma_rad</code></td>
<td><code>0.012</code></td>
<td>&gt; 0</td>
<td>Body motion on the suspension, added to the sensor's accuracy, rad.</td>
</tr>
<tr>
<td><code>doppler_sigma_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Velocity accuracy of a log that states none, m/s.</td>
</tr>
<tr>
<td><code>gnss_v_sigma_m</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Vertical accuracy of a log that states none, m.</td>
</tr>
<tr>
<td><code>altitude_correlation_s</code></td>
<td><code>60</code></td>
<td>≥ 0</td>
<td>GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>heading</code></td>
<td><code>command</code></td>
<td>command</td>
<td>What the INS heading is: a command, for two states do not hold it.</td>
</tr>
<tr>
<td><code>command_form</code></td>
<td><code>components</code></td>
<td>components, printed</td>
<td>The command B u: of u = [v cos, v sin], or of u = [v, heading] as printed, which runs away.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`gps-ins-ekf\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>dem_sigma_m</code></td>
<td><code>6</code></td>
<td>&gt; 0</td>
<td>Accuracy of the terrain's height, m (thesis: 6 World 30, 12.6 ASTER).</td>
</tr>
<tr>
<td><code>dem_correlation_m</code></td>
<td><code>300</code></td>
<td>≥ 0</td>
<td>Terrain errors hang together this far, m: an epoch counts for dx / (dx + 2 L).</td>
</tr>
<tr>
<td><code>dem_min_quality</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 200</td>
<td>Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from other sources, 0 keeps all.</td>
</tr>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s; samples between them are averaged (thesis: 1).</td>
</tr>
<tr>
<td><code>command_at</code></td>
<td><code>midpoint</code></td>
<td>midpoint, start</td>
<td>Speed and heading of a step: mean of its two ends, or those at its start (thesis).</td>
</tr>
<tr>
<td><code>gnss_sigma_m</code></td>
<td><code>12.5</code></td>
<td>&gt; 0, ≤ 1000</td>
<td>Accuracy of a position per axis where the log states none, m (thesis: 10 to 15).</td>
</tr>
<tr>
<td><code>fix_correlation_s</code></td>
<td><code>5</code></td>
<td>≥ 0, ≤ 1000</td>
<td>GNSS position errors hang together this long, s: a fix counts for dt / (dt + 2 tau) (thesis: 0).</td>
</tr>
<tr>
<td><code>process_sigma_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 100</td>
<td>Process noise of position per axis, m per root second (thesis: 0.5).</td>
</tr>
<tr>
<td><code>drift_share</code></td>
<td><code>0.01</code></td>
<td>≥ 0, ≤ 1</td>
<td>Spread that dead reckoning adds in an outage, as a share of the way since the last fix (thesis: 0).</td>
</tr>
<tr>
<td><code>heading_sigma_rad</code></td>
<td><code>0.05</code></td>
<td>&gt; 0, ≤ 3.2</td>
<td>Accuracy of the heading where the log states none, rad.</td>
</tr>
<tr>
<td><code>align_heading</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Turn the yaw sensor to the course over the whole drive before filtering.</td>
</tr>
<tr>
<td><code>hold_s</code></td>
<td><code>5</code></td>
<td>≥ 0, ≤ 60</td>
<td>How long the last speed and heading stand in for missing ones, s; widened with their age.</td>
</tr>
<tr>
<td><code>gate_probability</code></td>
<td><code>0.999</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Share of good fixes that the innovation gate lets pass (chi-square); 1 takes every fix (thesis).</td>
</tr>
<tr>
<td><code>restart_after</code></td>
<td><code>3</code></td>
<td>≥ 1, ≤ 1000</td>
<td>Fixes rejected in a row after which the filter starts anew at the last.</td>
</tr>
<tr>
<td><code>min_speed_mps</code></td>
<td><code>1</code></td>
<td>≥ 0, ≤ 20</td>
<td>Below this speed pitch and course say nothing, m/s.</td>
</tr>
<tr>
<td><code>match_gate</code></td>
<td><code>2.55</code></td>
<td>&gt; 0</td>
<td>Largest Mahalanobis distance of a map match.</td>
</tr>
<tr>
<td><code>map_sigma_m</code></td>
<td><code>4</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's position, lane offset included, m.</td>
</tr>
<tr>
<td><code>map_sigma_rad</code></td>
<td><code>0.3</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's direction, rad.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>3</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs.</td>
</tr>
<tr>
<td><code>height</code></td>
<td><code>gnss</code></td>
<td>gnss, dem</td>
<td>What measures the height: GNSS altitude (the DEM where the log has none), or the DEM.</td>
</tr>
<tr>
<td><code>climb</code></td>
<td><code>all</code></td>
<td>all, pitch, doppler, none</td>
<td>Command of the height: pitch times speed and vertical Doppler velocity, one of them, or none.</td>
</tr>
<tr>
<td><code>level_pitch</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Take the pitch sensor's mount off before filtering.</td>
</tr>
<tr>
<td><code>pitch_sigma_rad</code></td>
<td><code>0.012</code></td>
<td>&gt; 0</td>
<td>Body motion on the suspension, added to the sensor's accuracy, rad.</td>
</tr>
<tr>
<td><code>doppler_sigma_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Velocity accuracy of a log that states none, m/s.</td>
</tr>
<tr>
<td><code>gnss_v_sigma_m</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Vertical accuracy of a log that states none, m.</td>
</tr>
<tr>
<td><code>altitude_correlation_s</code></td>
<td><code>60</code></td>
<td>≥ 0</td>
<td>GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>heading</code></td>
<td><code>measurement</code></td>
<td>command, overwrite, measurement</td>
<td>What the INS heading is: a measurement of the third state, a value that overwrites it, or a command (two states).</td>
</tr>
<tr>
<td><code>heading_reset</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Overwriting the heading resets its variance and covariances; without, as the thesis may mean it.</td>
</tr>
<tr>
<td><code>heading_walk_rad</code></td>
<td><code>0.3</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Process noise of the heading while moving, rad per root second.</td>
</tr>
<tr>
<td><code>innovation</code></td>
<td><code>residual</code></td>
<td>residual, printed</td>
<td>What the gain multiplies: Z - h(x), or h(x) as printed, which diverges.</td>
</tr>
<tr>
<td><code>jacobian</code></td>
<td><code>derivative</code></td>
<td>derivative, printed</td>
<td>Heading column of the Jacobian: the derivative, or sine and cosine exchanged and without dt as printed.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`gps-ins-ukf\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>dem_sigma_m</code></td>
<td><code>6</code></td>
<td>&gt; 0</td>
<td>Accuracy of the terrain's height, m (thesis: 6 World 30, 12.6 ASTER).</td>
</tr>
<tr>
<td><code>dem_correlation_m</code></td>
<td><code>300</code></td>
<td>≥ 0</td>
<td>Terrain errors hang together this far, m: an epoch counts for dx / (dx + 2 L).</td>
</tr>
<tr>
<td><code>dem_min_quality</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 200</td>
<td>Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from other sources, 0 keeps all.</td>
</tr>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s; samples between them are averaged (thesis: 1).</td>
</tr>
<tr>
<td><code>command_at</code></td>
<td><code>midpoint</code></td>
<td>midpoint, start</td>
<td>Speed and heading of a step: mean of its two ends, or those at its start (thesis).</td>
</tr>
<tr>
<td><code>gnss_sigma_m</code></td>
<td><code>12.5</code></td>
<td>&gt; 0, ≤ 1000</td>
<td>Accuracy of a position per axis where the log states none, m (thesis: 10 to 15).</td>
</tr>
<tr>
<td><code>fix_correlation_s</code></td>
<td><code>5</code></td>
<td>≥ 0, ≤ 1000</td>
<td>GNSS position errors hang together this long, s: a fix counts for dt / (dt + 2 tau) (thesis: 0).</td>
</tr>
<tr>
<td><code>process_sigma_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 100</td>
<td>Process noise of position per axis, m per root second (thesis: 0.5).</td>
</tr>
<tr>
<td><code>drift_share</code></td>
<td><code>0.01</code></td>
<td>≥ 0, ≤ 1</td>
<td>Spread that dead reckoning adds in an outage, as a share of the way since the last fix (thesis: 0).</td>
</tr>
<tr>
<td><code>heading_sigma_rad</code></td>
<td><code>0.05</code></td>
<td>&gt; 0, ≤ 3.2</td>
<td>Accuracy of the heading where the log states none, rad.</td>
</tr>
<tr>
<td><code>align_heading</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Turn the yaw sensor to the course over the whole drive before filtering.</td>
</tr>
<tr>
<td><code>hold_s</code></td>
<td><code>5</code></td>
<td>≥ 0, ≤ 60</td>
<td>How long the last speed and heading stand in for missing ones, s; widened with their age.</td>
</tr>
<tr>
<td><code>gate_probability</code></td>
<td><code>0.999</code></td>
<td>&gt; 0, ≤ 1</td>
<td>Share of good fixes that the innovation gate lets pass (chi-square); 1 takes every fix (thesis).</td>
</tr>
<tr>
<td><code>restart_after</code></td>
<td><code>3</code></td>
<td>≥ 1, ≤ 1000</td>
<td>Fixes rejected in a row after which the filter starts anew at the last.</td>
</tr>
<tr>
<td><code>min_speed_mps</code></td>
<td><code>1</code></td>
<td>≥ 0, ≤ 20</td>
<td>Below this speed pitch and course say nothing, m/s.</td>
</tr>
<tr>
<td><code>match_gate</code></td>
<td><code>2.55</code></td>
<td>&gt; 0</td>
<td>Largest Mahalanobis distance of a map match.</td>
</tr>
<tr>
<td><code>map_sigma_m</code></td>
<td><code>4</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's position, lane offset included, m.</td>
</tr>
<tr>
<td><code>map_sigma_rad</code></td>
<td><code>0.3</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's direction, rad.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>3</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs.</td>
</tr>
<tr>
<td><code>height</code></td>
<td><code>gnss</code></td>
<td>gnss, dem</td>
<td>What measures the height: GNSS altitude (the DEM where the log has none), or the DEM.</td>
</tr>
<tr>
<td><code>climb</code></td>
<td><code>all</code></td>
<td>all, pitch, doppler, none</td>
<td>Command of the height: pitch times speed and vertical Doppler velocity, one of them, or none.</td>
</tr>
<tr>
<td><code>level_pitch</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Take the pitch sensor's mount off before filtering.</td>
</tr>
<tr>
<td><code>pitch_sigma_rad</code></td>
<td><code>0.012</code></td>
<td>&gt; 0</td>
<td>Body motion on the suspension, added to the sensor's accuracy, rad.</td>
</tr>
<tr>
<td><code>doppler_sigma_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Velocity accuracy of a log that states none, m/s.</td>
</tr>
<tr>
<td><code>gnss_v_sigma_m</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Vertical accuracy of a log that states none, m.</td>
</tr>
<tr>
<td><code>altitude_correlation_s</code></td>
<td><code>60</code></td>
<td>≥ 0</td>
<td>GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>heading</code></td>
<td><code>measurement</code></td>
<td>command, overwrite, measurement</td>
<td>What the INS heading is: a measurement of the third state, a value that overwrites it, or a command (two states).</td>
</tr>
<tr>
<td><code>heading_reset</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Overwriting the heading resets its variance and covariances; without, as the thesis may mean it.</td>
</tr>
<tr>
<td><code>heading_walk_rad</code></td>
<td><code>0.3</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Process noise of the heading while moving, rad per root second.</td>
</tr>
<tr>
<td><code>alpha</code></td>
<td><code>0.001</code></td>
<td>≥ 0.0001, ≤ 1000</td>
<td>Spread of the sigma points (thesis: 1e-4 to 1; printed: 1e3).</td>
</tr>
<tr>
<td><code>beta</code></td>
<td><code>2</code></td>
<td>≥ 0, ≤ 10</td>
<td>Weight of the centre in the covariance (thesis: 2).</td>
</tr>
<tr>
<td><code>kappa</code></td>
<td><code>-1</code></td>
<td>&gt; -2, ≤ 10</td>
<td>Second spread, added to the number of states (thesis: -1).</td>
</tr>
<tr>
<td><code>redraw</code></td>
<td><code>true</code></td>
<td>true, false</td>
<td>Draw new sigma points after the process noise is added; without, as printed, it is added last.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`ukf-dem\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s; samples between them are averaged (thesis: 1).</td>
</tr>
<tr>
<td><code>discretisation</code></td>
<td><code>thesis</code></td>
<td>thesis, exact</td>
<td>Position row as printed (2.1), or with the a dt^2/2 of constant acceleration.</td>
</tr>
<tr>
<td><code>match_gate</code></td>
<td><code>2.55</code></td>
<td>&gt; 0</td>
<td>Largest Mahalanobis distance of a map match (thesis: 2.55).</td>
</tr>
<tr>
<td><code>antenna_height_m</code></td>
<td><code>1.55</code></td>
<td>≥ 0, ≤ 10</td>
<td>Antenna above the road, m (thesis: 1.55).</td>
</tr>
<tr>
<td><code>doppler</code></td>
<td><code>false</code></td>
<td>true, false</td>
<td>Use velocity too, Doppler or else the fixes' own rate of change; the original has none.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>3</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs (thesis: 3; its experiment 4).</td>
</tr>
<tr>
<td><code>min_speed_mps</code></td>
<td><code>1</code></td>
<td>≥ 0</td>
<td>Below this speed pitch and heading say nothing, m/s.</td>
</tr>
<tr>
<td><code>sigma_acc_mps2</code></td>
<td><code>3</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal acceleration, m/s2 per root second.</td>
</tr>
<tr>
<td><code>sigma_vel_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal velocity, m/s per root second.</td>
</tr>
<tr>
<td><code>sigma_pos_m</code></td>
<td><code>1</code></td>
<td>&gt; 0</td>
<td>Process noise of horizontal position, m per root second.</td>
</tr>
<tr>
<td><code>sigma_acc_up_mps2</code></td>
<td><code>0.002</code></td>
<td>&gt; 0</td>
<td>Process noise of vertical acceleration, m/s2 per root second.</td>
</tr>
<tr>
<td><code>sigma_vel_up_mps</code></td>
<td><code>0.03</code></td>
<td>&gt; 0</td>
<td>Process noise of vertical velocity, m/s per root second.</td>
</tr>
<tr>
<td><code>sigma_pos_up_m</code></td>
<td><code>2</code></td>
<td>&gt; 0</td>
<td>Process noise of altitude, m per root second.</td>
</tr>
<tr>
<td><code>gnss_h_sigma_m</code></td>
<td><code>2.5</code></td>
<td>&gt; 0</td>
<td>Horizontal accuracy (2-D) of a log that states none, m.</td>
</tr>
<tr>
<td><code>gnss_v_sigma_m</code></td>
<td><code>5</code></td>
<td>&gt; 0</td>
<td>Vertical accuracy of a log that states none, m.</td>
</tr>
<tr>
<td><code>gnss_correlation_s</code></td>
<td><code>2</code></td>
<td>≥ 0</td>
<td>GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau).</td>
</tr>
<tr>
<td><code>doppler_sigma_mps</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Velocity accuracy of a log that states none, m/s.</td>
</tr>
<tr>
<td><code>rate_sigma_mps</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Best accuracy of a velocity taken from the fixes' rate of change, m/s; scatter widens it.</td>
</tr>
<tr>
<td><code>start_altitude_sigma_m</code></td>
<td><code>0.5</code></td>
<td>&gt; 0</td>
<td>Spread of altitude in a new state, m: the receiver's own datum is kept, slopes need no other.</td>
</tr>
<tr>
<td><code>map_sigma_m</code></td>
<td><code>4</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's position, lane offset included, m.</td>
</tr>
<tr>
<td><code>map_sigma_rad</code></td>
<td><code>0.2</code></td>
<td>&gt; 0</td>
<td>Accuracy of the map's direction, rad.</td>
</tr>
<tr>
<td><code>dem_sigma_m</code></td>
<td><code>12.6</code></td>
<td>&gt; 0</td>
<td>Accuracy of the terrain's height, m (thesis: 12.6 ASTER, 6 World 30).</td>
</tr>
<tr>
<td><code>dem_correlation_m</code></td>
<td><code>0</code></td>
<td>≥ 0</td>
<td>Terrain errors hang together this far, m (original: not at all): an epoch counts for dx / (dx + 2 L).</td>
</tr>
<tr>
<td><code>dem_min_quality</code></td>
<td><code>0</code></td>
<td>≥ 0, ≤ 200</td>
<td>Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from other sources, 0 keeps all.</td>
</tr>
<tr>
<td><code>dem_window</code></td>
<td><code>tin</code></td>
<td>tin, adjacent, full, hollow</td>
<td>Selection of terrain points (original: tin, triangles).</td>
</tr>
<tr>
<td><code>alpha</code></td>
<td><code>0.001</code></td>
<td>&gt; 0, ≤ 1</td>
<td>How far sigma points lie from the mean, as a share of their spread.</td>
</tr>
<tr>
<td><code>beta</code></td>
<td><code>2</code></td>
<td>≥ 0</td>
<td>What is known of the distribution's tails; 2 for a Gaussian.</td>
</tr>
<tr>
<td><code>kappa</code></td>
<td><code>0</code></td>
<td>&gt; -9, ≤ 100</td>
<td>Secondary spread of the sigma points, above minus the number of states.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`raw\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s.</td>
</tr>
<tr>
<td><code>min_epochs</code></td>
<td><code>4</code></td>
<td>≥ 2, ≤ 100</td>
<td>Altitudes that a slope needs.</td>
</tr>
</tbody>
</table></div>
</details>
<details><summary>Options of \`dem\`</summary>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>option</th>
<th>default</th>
<th>allowed</th>
<th>meaning</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>period_s</code></td>
<td><code>0.5</code></td>
<td>&gt; 0, ≤ 10</td>
<td>Shortest time between two epochs, s.</td>
</tr>
<tr>
<td><code>height_sigma_m</code></td>
<td><code>3.5</code></td>
<td>&gt; 0</td>
<td>Error of a terrain height against its neighbourhood, m.</td>
</tr>
<tr>
<td><code>correlation_m</code></td>
<td><code>90</code></td>
<td>&gt; 0</td>
<td>Distance over which terrain errors hang together, m.</td>
</tr>
</tbody>
</table></div>
</details>
<h2 id="terrain-windows"><a class="self" href="#terrain-windows">Terrain windows</a></h2>
<p>Option <code>dem_window</code>: which points of the elevation model say how high a segment lies.</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>window</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>tin</code></td>
<td>the two triangles of each cell (chapter 2): follows the ground, no smoothing</td>
</tr>
<tr>
<td><code>adjacent</code></td>
<td>plane through the corners of the cells that the segment crosses (FGA)</td>
</tr>
<tr>
<td><code>full</code></td>
<td>plane through the rectangle around the segment, one cell wider</td>
</tr>
<tr>
<td><code>hollow</code></td>
<td>plane through the border of the rectangle around the segment</td>
</tr>
</tbody>
</table></div>
<h2 id="resampling"><a class="self" href="#resampling">Resampling</a></h2>
<p>Option <code>resampling</code> of <code>particle</code>:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>scheme</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>multinomial</code></td>
<td>Independent draws (1.51), the scheme of the thesis's experiment.</td>
</tr>
<tr>
<td><code>residual</code></td>
<td>The whole part of n w_i copies of each particle (1.53); independent draws from what is left over (1.54).</td>
</tr>
<tr>
<td><code>stratified</code></td>
<td>One independent draw in each of n equal parts of [0, 1).</td>
</tr>
<tr>
<td><code>systematic</code></td>
<td>One draw and equal steps (1.55): each particle gets floor or ceil of its expected number of descendants.</td>
</tr>
</tbody>
</table></div>
<p>Option <code>resampling_trigger</code> of <code>particle</code>; <code>trigger_threshold</code> is its threshold:</p>
<div class="wide" tabindex="0"><table>
<thead>
<tr>
<th>trigger</th>
<th>what</th>
</tr>
</thead>
<tbody>
<tr>
<td><code>n_eff</code></td>
<td>Resample when N_eff (1.50) falls below this share of the particles (thesis: 2/3).</td>
</tr>
<tr>
<td><code>entropy</code></td>
<td>Resample when S_w (1.49) rises above this; 0.2 is where log-normal weights have an N_eff of 2/3 N.</td>
</tr>
<tr>
<td><code>never</code></td>
<td>Never resample: sequential importance sampling (SIS); no threshold is used.</td>
</tr>
</tbody>
</table></div>
`;export{e as default};