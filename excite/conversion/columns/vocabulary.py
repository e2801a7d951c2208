"""Words that columns are called by in drivers, middleware, vendors' loggers and papers."""

from __future__ import annotations

# Words by the quantity that they name, as drivers, middleware and papers write them.
QUANTITIES: dict[str, tuple[str, ...]] = {
    "skip": tuple(
        (
            "enable enabled on done success err error errors ext external extern hat temp temps temperature "
            "status mode tcp cartesian flange eef id seq residual deviation tracking model ee tip wrench ft "
            "imu gyro tool gripper contact disturbance load_est crc kp kd ki stiffness damping "
            # What was made of many samples, and ends of ranges; the rate of a torque has no channel in a log.
            "min max std stddev var rms minimum maximum dtau "
            # Parts of MuJoCo's generalised forces beside the actuators'; sines and cosines that policies are fed with.
            "bias passive constraint gravcomp cos sin"
        ).split()
    ),
    "time": tuple(
        (
            "time timestamp timestamps ipoc t stamp tstamp clock tick ticks zeit times ts sec secs seconds "
            "millis msec usec nsec tm elapsed uptime utime date datenum datetime zeitstempel horodatage fecha"
        ).split()
    ),
    "a": tuple(
        (
            "a acc accel acceleration accelerations ddq qdd qddot qacc ddtheta dd ddqs qdds qaccs thetaddot "
            "ddot alpha ddpos accs"
        ).split()
    ),
    "v": tuple(
        (
            "v vel vels velocity velocities speed speeds dq qd qdot qvel dtheta omega drehzahl vitesse "
            "velocidad velocita thetadot dot dpos velo spd rate qp geschwindigkeit thetad dof_vel dqs qds "
            "qdots qvels w rpm qv alphain alphaout"
        ).split()
    ),
    "tau": tuple(
        (
            "tau taus torque torques trq tq effort efforts eff moment drehmoment actuatorfrc trqs qfrc tor "
            "frc force forces torq tauj nm mot_torque couple coppia tauin tauout"
        ).split()
    ),
    "i": tuple(
        ("current currents cur curr amp amps ampere iq i strom motcur courant corrente corriente").split()
    ),
    "volt": tuple(("volt volts voltage voltages vir pwm duty u load pwms uq").split()),
    "q": tuple(
        (
            "q pos position positions angle angles theta qpos jointpos encoder enc qs displacement disp p th "
            "ang winkel phi posn jpos coord rotation lage posicion posizione thetas jointpositions qposs qin "
            "qout pulse pulses impulse impulses inkrement inkremente increments impulsions"
        ).split()
    ),
}
OF_WORD = {word: quantity for quantity, words in QUANTITIES.items() for word in words}
# Parts of hands, which are recorded beside arms whose models end at the wrist.
OF_HANDS = frozenset("hand hands finger fingers thumb thumbs pinky palm gripper grippers claw claws".split())
# KUKA writes AIPos and ASPos for actual and set positions of axes.
COMMANDED = frozenset(
    "cmd cmds command commanded commands des desired ref refs reference references target targets goal goals "
    "setpoint setpoints sp set action actions ctrl ctrls control controls "
    # Isaac Lab calls a torque computed before it is clipped, and applied then.
    "computed "
    "soll sollwert consigne ff feedforward d want demand nominal requested input in as "
    # mc_rtc calls what goes to the robot out, and what comes from it in.
    "planned plan ipo interpolated interp prescribed qout tauout alphaout".split()
)
# Of them, words that mean nothing else: what a robot of one joint is asked for needs no other word.
SURELY_COMMANDED = COMMANDED - frozenset(
    "d in input as set nominal computed ff feedforward want demand".split()
)
MEASURED = frozenset(
    "act actual ist istwert mesure mesuree reel reelle meas measured state obs observation feedback fb fbk real "
    # Msr and Msrd are what KUKA's Sunrise records as measured.
    "present raw sensor est mes msr msrd messwert gemessen applied ai qin tauin alphain".split()
)
# What drives a joint that slides, or presses on a foot or a tool.
FORCES = frozenset("force forces frc kraft".split())
# Words of what is measured that name the message rather than the signal: ``state.q_d`` is the desired position in it.
OF_MESSAGE = frozenset("state obs observation".split())
# Words of topics and tables whose signals are beside what was measured at the joints.
ASIDE = frozenset("ext external extern disturbance residual model expected simulated".split())
# Of a drive's rated torque or current, whose size no recording holds.
SHARES = frozenset("percent percentage pct permille permil prozent normalized normalised".split())
# Where joints are elastic, theta is the motor's side of them and q the link's.
OF_MOTOR = frozenset("theta dtheta thetad thetadot".split())
# Words that leave no doubt; a ``feedback`` torque may be the controller's part.
SURELY_MEASURED = frozenset(
    "actual act measured meas real ist istwert mes msr msrd messwert gemessen mesure mesuree reel reelle".split()
)
NOISE = frozenset(
    "joint joints jnt j motor mot m axis ax dof link robot arm data value msg states position0 deg rad".split()
)
KNOWN = frozenset(OF_WORD) | COMMANDED | MEASURED | NOISE
