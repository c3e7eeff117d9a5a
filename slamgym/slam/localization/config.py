"""Settings of the localisation on a finished map, named after AMCL's parameters where it has them."""

from typing import Literal

from slamgym.core.config import Count, NonNegative, Positive, PositiveShare, Settings, Share

Start = Literal["global", "known"]


class LocalizationConfig(Settings, section="slam.localization"):
    """How a robot finds itself on a map and follows its own motion there.

    The sensor model is the likelihood field of Thrun, Burgard and Fox (*Probabilistic Robotics*, 2005, Table 6.3),
    the filter their Monte Carlo localisation (Tables 8.2 and 8.3), the number of particles KLD-sampling's (Table
    8.4; Fox 2003). Several hypotheses are kept apart, each with particles of its own (Vermaak, Doucet and Perez
    2003), so that chance kills none of them.
    """

    start: Start = "global"
    """``global``: nothing is known of the start; ``known``: the start is the initial pose, as in AMCL."""

    max_beams: Count = 60
    """Beams of a scan that weigh the particles (``laser_max_beams``; 30 in AMCL's launch file, 60 in Nav2)."""

    sigma_hit: Positive = 0.08
    """Spread of end points round the mapped surface [m] (``laser_sigma_hit``; 0.2 in AMCL): the error of a TurtleBot3's
    laser and that of a map with 5 cm cells."""

    z_hit: PositiveShare = 0.75
    """Share of beams that end at what is mapped (``laser_z_hit``) ..."""

    z_rand: PositiveShare = 0.2
    """... of those that end anywhere: people, moved furniture (``laser_z_rand``) ..."""

    z_max: PositiveShare = 0.05
    """... and of those that a mapped surface doesn't return (``laser_z_max``)."""

    beam_weight: Positive = 0.15
    """Power that the likelihood of a beam is taken to, because neighbouring beams and successive scans err together
    (Thrun et al. 2005, section 6.3.4). Chosen so that NEES is between 2 and 5."""

    evidence: PositiveShare = 0.2
    """What a scan says for one hypothesis against another, as a share of what it says within one: what isn't on the map
    speaks against a place in many scans on end."""

    jump_cost: NonNegative = 10.0
    """Log-weight that a new place begins behind the one that is followed: robots are seldom carried off."""

    linear_update: NonNegative = 0.1
    """A scan is processed after this distance [m] (``update_min_d``; 0.25 in Nav2) ..."""

    angular_update: NonNegative = 0.1
    """... or this turn [rad] (``update_min_a``; 0.2)."""

    min_particles: Count = 100
    """Least particles of a hypothesis (``min_particles`` of all)."""

    max_particles: Count = 2000
    """Most particles of all hypotheses together, but for the least of each (``max_particles``)."""

    kld_error: Positive = 0.05
    """Error of the particles' distribution (``pf_err``) ..."""

    kld_quantile: Positive = 2.33
    """... that is kept with a probability of 0.99 (``pf_z``)."""

    resample_threshold: Share = 0.5
    """Resample when N_eff falls below this share of the particles."""

    initial_spread: Positive = 0.5
    """Standard deviation of a known start [m] (``initial_cov_xx`` is its square) ..."""

    initial_turn: Positive = 0.26
    """... and of its heading [rad]."""

    most_hypotheses: Count = 60
    """The best places that a search keeps."""

    score_margin: Share = 0.12
    """A place is kept if its score falls so much behind the best one's at most (1: every point lies on a wall)."""

    search_memory: Positive = 3.0
    """A search takes the scans of so many metres driven together ..."""

    search_distance: Positive = 0.5
    """... and is repeated after so many while the robot isn't localised [m], each time after more, up to ..."""

    check_distance: Positive = 5.0
    """... so many, and after as many while it is, to see whether another place explains more [m]."""

    minimum_fit: Share = 0.6
    """A hypothesis explains the scans if so many of their beams, in a mean over the latest, end at a mapped surface
    with none in between."""

    claim_fit: Share = 0.75
    """So many must be explained over all scans since a place was found before it is believed for the first time."""

    fit_distance: Positive = 0.2
    """How near an end point must lie to a surface for that [m]."""

    certain_weight: PositiveShare = 0.95
    """One hypothesis needs this share of all weight to be the robot's place."""

    confirm_distance: NonNegative = 3.0
    """So far the robot must have driven with one hypothesis certain before it is believed [m]; half a turn counts as
    much as a metre. Twice as far after each place that was believed and given up."""
