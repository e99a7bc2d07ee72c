"""Initial state: record of an episode at tick 0, with its parts in the order of the fields."""

import math
import reprlib
from dataclasses import replace

from twin_gait.control import gait_controller as ccu
from twin_gait.control.controller import mistake, require_whole_numbers
from twin_gait.control.joint_board import BoardState, Limits, Rates
from twin_gait.control.supervisor import NO_POSTURE, ModeCommand, Supervisor
from twin_gait.core.actuator import Motor
from twin_gait.core.contact import Point
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, Setpoint, new_encoder
from twin_gait.core.estimation import first_order_gain, new_delay_line
from twin_gait.core.guards import Comparison, GuardNode, GuardProgram, TransitionRule
from twin_gait.core.inertial import TrunkUnit
from twin_gait.core.plant import ImposedMotion
from twin_gait.core.safety import Bounds
from twin_gait.gait.modes import Mode, ModeTable
from twin_gait.gait.program import compile_guards
from twin_gait.gait.table import TICK
from twin_gait.kernels.generated import KernelBodies, body_values
from twin_gait.network.bus import MEASUREMENT, SETPOINT, cyclic_messages, new_bus
from twin_gait.network.dbc import load_messages
from twin_gait.parameters import NetworkParameters
from twin_gait.parameters.quantities import taken_from
from twin_gait.simulation import episode
from twin_gait.simulation.problem import NEVER, Problem, fault_records, phase_time_out_ticks, ticks
from twin_gait.simulation.record import ABSENT, Record, float_in, is_record
from twin_gait.vocabulary import LEAN, LOWER, REACH_BACK, RISE, SIT, STRAIGHTEN, JointName
from twin_gait.worlds.arm_policy import LEANS, LOWERS, REACHES, RISES, SITS

MOST_SWITCHES_PER_SECOND = 200
# Lists are padded to a multiple of this, so that gait tables of similar size share one loop.
_CAPACITY = 16
# Perceived state of sitting on a chair, by phase.
FELT = {SIT: SITS, LEAN: LEANS, RISE: RISES, STRAIGHTEN: RISES, REACH_BACK: REACHES, LOWER: LOWERS}
_LATELY = 32  # Ring buffers of the bus are padded likewise, to a multiple of this [ticks].


def new_episode(problem: Problem, bodies: KernelBodies) -> episode.Episode:
    """Return the episode of a simulation setup at tick 0.

    It may share parts with the world, and refer to one part twice. ``bodies``: bodies for which the kernels
    of plant and controller are generated.
    """
    experiment, world = problem.experiment, problem.world
    n, stepping, phases = len(world.start_q), experiment.stepping, problem.table.phases
    most_switches = max(100, int(MOST_SWITCHES_PER_SECOND * experiment.duration))
    faults = fault_records(problem)
    legs = world.model.legs.items()
    ankles = [world.model.index(side, JointName.ANKLE) for side, leg in legs if leg.ankle is not None]
    passive = [world.model.index(side, joint) for side, joint in problem.passive]
    return taken_from(
        episode.Episode,
        world,
        step=stepping.step,
        substeps=stepping.substeps,
        gravity=experiment.plant.gravity,
        fall_height=float(world.fall_height),
        watching=experiment.control.safety.enabled,
        first_fault=min((fault.start_tick for fault in faults), default=NEVER),
        q=world.start_q.tolist(),
        v=world.start_v.tolist(),
        a=[0.0] * n,
        motor=[0.0] * n,
        external=[0.0] * n,
        voluntary=[0.0] * n,
        passive_moment=[0.0] * n,
        torque=[0.0] * n,
        stages=episode.Stages(*([0.0] * n for _ in range(4))),
        bodies=body_values(bodies.bodies, bodies.points),
        rates=Rates(TICK, problem.fast_gain, experiment.sensors.decimation, problem.table.blending.law.code),
        supply=_supply(problem),
        limits=limits_of(problem, problem.experiment.network),
        controller=_controller(problem, body_values(bodies.control_bodies)),
        joints=[_joint(problem, number) for number in range(len(problem.joints))],
        soles=[episode.Sole() for _ in problem.sides],
        network=ABSENT if experiment.network is None else _network(problem, experiment.network),
        limbs=problem.limbs,
        ankles=ankles,
        passive=passive,
        ground=world.ground(),
        points=[Point() for _ in range(max(len(bodies.points), 1))],
        imposed_motion=world.imposed_motion or ImposedMotion(),
        braces=[] if world.braces is None else world.braces.braces,
        braced=[*(joint.coordinate for joint in problem.joints), *passive],
        faults=faults,
        requests=_requests(problem),
        trunk_unit=_trunk_unit(problem) if problem.inertial else ABSENT,
        swing_phases=[float(problem.table.is_swing(name)) for name in phases if world.arms],
        chair_phases=[FELT.get(name, 0.0) for name in phases if world.arms or world.seat is not None],
        recording=episode.Recording(most_switches, len(problem.noise)),
    )


def _supply(problem: Problem) -> episode.Supply:
    battery, electronics = problem.experiment.plant.battery, problem.experiment.plant.electronics
    power = electronics.constant_power + len(problem.joints) * electronics.inverter_power
    voltage, resistance = battery.voltage, battery.internal_resistance
    return episode.Supply(voltage, resistance, power, electronics.regeneration, bus_voltage=voltage)


def limits_of(problem: Problem, network: NetworkParameters | None) -> Limits:
    """Return the limits of boards and gait controller; without a network there is no timeout of messages."""
    control = problem.experiment.control
    safety = control.safety
    heeded = network if safety.enabled else None
    return taken_from(
        Limits,
        control.limits,
        phase_ticks=phase_time_out_ticks(problem),
        frozen_load_ticks=ticks(safety.frozen_load_time),
        controller_silence=NEVER if heeded is None else ticks(heeded.board_silence),
        board_silence=NEVER if heeded is None else ticks(heeded.ccu_silence),
        lowering_ticks=ticks(safety.lowering_time),
        hold_damping=safety.hold_damping,
    )


def _controller(problem: Problem, bodies: list[float]) -> ccu.ControllerState:
    experiment, control = problem.experiment, problem.experiment.control
    supply, settings, modes = experiment.plant.battery.voltage, control.safety, experiment.modes
    gain, memory = control.inertia_compensation, problem.controller.memory(problem.plan)
    if not is_record(memory):
        expected = "a memory that is a dataclass with slots, of numbers, such dataclasses and lists of them"
        raise mistake(problem.controller.name, expected, reprlib.repr(memory))
    require_whole_numbers(problem.controller.name, float_in(memory))
    q, a, gravity, inertia = ([0.0] * problem.control_model.nv for _ in range(4))
    legs = [_leg(problem, number) for number in range(len(problem.sides))]
    return ccu.ControllerState(
        joints=[
            _controlled_joint(problem, number, legs[number // problem.joints_per_leg].phase)
            for number in range(len(problem.joints))
        ],
        legs=legs,
        program=_padded(problem.program),
        signals=problem.table.in_si({}),
        supply=ccu.WatchedSupply(
            supply, settings.least_voltage_share * supply, low_ticks=ticks(settings.voltage_time)
        ),
        model=ccu.ControlModel(bodies, experiment.plant.gravity, q, a, gravity, inertia, gain),
        memory=memory,
        supervisor=ABSENT if modes is None else _supervisor(problem, modes),
    )


def _controlled_joint(problem: Problem, number: int, phase: int) -> ccu.ControlledJoint:
    joint, control = problem.joints[number], problem.experiment.control
    leg, position = divmod(number, problem.joints_per_leg)
    first = COLUMNS_PER_JOINT * position
    rows = problem.phase_rows[leg, :, first : first + COLUMNS_PER_JOINT].tolist()
    setpoints = [Setpoint(*row) for row in rows]
    return ccu.ControlledJoint(
        control_place=joint.control_coordinate,
        setpoints=setpoints,
        blend_start=setpoints[phase],
        blended=setpoints[phase],
        target=control.target_torque.get(joint.joint, 0.0),
        silent_ticks=-problem.bus_delay,
    )


def _leg(problem: Problem, number: int) -> ccu.ControlledLeg:
    side = problem.sides[number]
    name = problem.world.initial_phases[side]
    phase = 0 if name is None else problem.table.phase_index(name)
    shares = problem.phase_rows[number, :, -1].tolist()
    return ccu.ControlledLeg(
        phase=phase,
        debounce=[0] * _capacity(problem.program.n_transitions),
        gravity_shares=shares,
        gravity_start=shares[phase],
        gravity=shares[phase],
        blend_ticks=[problem.table.blend_ticks(phase) for phase in problem.table.phases_of(side).values()],
        frozen_speed=problem.experiment.control.safety.frozen_speed,
    )


def _supervisor(problem: Problem, modes: ModeTable) -> Supervisor:
    table, initial = problem.table, problem.experiment.initial_mode
    modes = replace(modes, joints=table.joints)  # the joints determine the order of the signals
    program = compile_guards(modes)

    def told(mode: Mode) -> ModeCommand:
        posture = NO_POSTURE if mode.posture is None else table.phase_index(mode.posture)
        return ModeCommand(posture, float(mode.walk), float(mode.step))

    return Supervisor(
        program=_padded(program),
        modes=[told(mode) for mode in modes.phases.values()],
        hold=modes.phase_index(modes.hold),
        swing=sum(1 << place for place, name in enumerate(table.phase_names) if table.is_swing(name)),
        signals=modes.in_si({}),
        debounce=[0] * _capacity(program.n_transitions),
        mode=0 if initial is None else modes.phase_index(initial),
    )


def _padded(program: GuardProgram) -> GuardProgram:
    """Return a guard program with padded lists, so that tables of similar size share one loop."""
    return replace(
        program,
        transitions=_with_room(program.transitions, TransitionRule(-1, 0, 0, 0, 0, 0)),
        nodes=_with_room(program.nodes, GuardNode(0, 0)),
        comparisons=_with_room(program.comparisons, Comparison(0, 0, 0.0, 0.0, 0.0)),
    )


def _with_room(entries: list[Record], blank: Record) -> list[Record]:
    return entries + [blank] * (_capacity(len(entries)) - len(entries))


def _capacity(count: int) -> int:
    return max(1, -(-count // _CAPACITY)) * _CAPACITY


def _joint(problem: Problem, number: int) -> episode.Joint:
    joint, experiment = problem.joints[number], problem.experiment
    actuator, inverter = problem.actuator(joint), experiment.plant.electronics.inverter_resistance
    motor = taken_from(Motor, actuator, resistance=actuator.resistance + inverter)
    angle = float(problem.world.start_q[joint.coordinate] + problem.offset[number])
    counts = experiment.sensors.encoder_counts * actuator.gear_ratio
    resolution = 0.0 if experiment.sensors.ideal else 2.0 * math.pi / counts
    return episode.Joint(
        place=joint.coordinate,
        board=BoardState(
            encoder=new_encoder(resolution, angle, experiment.sensors.window),
            motor=motor,
            friction_model=experiment.control.friction_model[joint.joint],
            bounds=_bounds(problem, number),
            # The first frames may need this number of ticks more.
            silent_ticks=-problem.bus_delay,
        ),
        motor=motor,
        # A command from the line is kept for the next tick, so the line is one tick shorter than the delay.
        line=new_delay_line(max(0, experiment.control.delay_ticks - 1)),
        reading=angle,
    )


def _bounds(problem: Problem, number: int) -> Bounds:
    """Return the bounds of the safety monitor for a joint."""
    joint, control, model = problem.joints[number], problem.experiment.control, problem.control_model
    settings, motor = control.safety, problem.actuator(joint)
    lower, upper = model.position_limits(joint.side, joint.joint)
    continuous = motor.continuous_torque / (motor.torque_constant * motor.gear_ratio)
    cooling = min(1.0, TICK / settings.thermal_time_constant)
    resistance = motor.resistance + problem.experiment.plant.electronics.inverter_resistance
    fastest = float(model.model.velocityLimit[joint.control_coordinate])  # 0 if the URDF has no limit
    return taken_from(
        Bounds,
        settings,
        lower=lower,
        upper=upper,
        highest_speed=settings.speed_share * (fastest if fastest > 0.0 else math.inf),
        stop_distance_factor=0.5 / settings.stopping_deceleration,
        frozen_ticks=ticks(settings.frozen_time),
        model_gain=min(1.0, TICK / settings.model_time_constant),
        highest_torque=control.limits.torque,
        torque_ticks=ticks(settings.torque_time),
        command_gain=min(1.0, TICK / settings.command_time_constant),
        highest_current=settings.current_share * control.limits.current,
        heating=cooling / (continuous * continuous),
        cooling=cooling,
        drive_ticks=ticks(settings.drive_time),
        emf_constant=motor.torque_constant * motor.gear_ratio,
        model_resistance=settings.model_resistance_ratio * resistance,
    )


def _network(problem: Problem, parameters: NetworkParameters) -> episode.Network:
    boards = [f"{joint.side}_{joint.joint}" for joint in problem.joints]
    messages = load_messages(parameters.dbc)
    frames, delay = cyclic_messages(messages, boards), problem.bus_delay
    room = (delay // _LATELY + 1) * _LATELY

    def wires(kind: str) -> list[episode.Wire]:
        carried = [messages[f"{board}_{kind}"] for board in boards]
        places = [(frames.index(message), message.layout) for message in carried]
        return [episode.Wire(*place, [episode.ReceivedFrame() for _ in range(room)]) for place in places]

    return episode.Network(
        bus=new_bus(parameters, frames, problem.experiment.seed, TICK),
        delay=delay,
        setpoints=wires(SETPOINT),
        measurements=wires(MEASUREMENT),
        numbers=[0.0] * max(len(message.signals) for message in frames),
    )


def _requests(problem: Problem) -> list[episode.TimedCommand]:
    """Return the requests of the experiment, padded, so that lists of similar length share one loop."""
    modes, requests = problem.experiment.modes, problem.experiment.requests
    if modes is None:
        return []
    asked = [episode.TimedCommand(item.ticks, 1 + modes.requests.index(item.name)) for item in requests]
    return _with_room(asked, episode.TimedCommand())


def _trunk_unit(problem: Problem) -> TrunkUnit:
    """Return the inertial measurement unit, whose estimate of the pitch is exact at the start."""
    sensor, place = problem.experiment.sensors.trunk, problem.world.model.pitch_index
    gain, pitch = first_order_gain(TICK, sensor.time_constant), float(problem.world.start_q[place])
    return taken_from(TrunkUnit, sensor, gain=gain, pitch=pitch)
