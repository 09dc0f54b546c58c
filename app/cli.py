"""The commands. Each reads its options, calls one service, and prints what came of it."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from rich.table import Table
from sqlalchemy.exc import OperationalError
from typer.exceptions import Abort, Exit, TyperException

from app.commands import (
    account,
    backup,
    export,
    lifecycle,
    machine,
    pool,
    retention,
    transcode,
    worker,
)
from app.commands.options import (
    Address,
    DataDir,
    Folder,
    Slug,
    address_of,
    app_context_of,
    closing_studios,
    out,
    say_links,
    settings_of,
)
from app.services.rollouts import pace
from app.services.runtime.errors import ConflictError, ServiceError, SlugTakenError
from app.services.runtime.settings import DATABASE_FILE
from app.services.studies import opening, repository, revision, slugs
from app.study.folder import UnknownStudyError
from app.study.scaffold import FolderNotEmptyError
from app.study.shortening import shortened
from app.study.validation_errors import StudyFaults, in_lines

commands = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="PBPO Studio: human evaluation studies by pairwise video choices.",
)
study_app = typer.Typer(no_args_is_help=True, help="Set studies up, open and close them.")
media_app = typer.Typer(no_args_is_help=True, help="The crane's recordings.")
link_app = typer.Typer(no_args_is_help=True, help="Links that each let one person in.")
study_app.add_typer(lifecycle.app)
study_app.add_typer(transcode.app)
commands.add_typer(study_app, name="study")
commands.add_typer(media_app, name="media")
commands.add_typer(account.commands, name="account")
commands.add_typer(machine.commands, name="machine")
commands.add_typer(link_app, name="link")
commands.add_typer(retention.commands, name="retention")
commands.command()(export.export)
commands.command()(backup.backup)
commands.command()(backup.restore)
commands.command()(export.report)
commands.command()(pool.pool)
commands.command()(worker.worker)

#: A user's mistake: what was asked for cannot be done as it was said.
MISTAKE = 2


class EvaluatorKind(StrEnum):
    certain = "certain"
    uncertain = "uncertain"


class CraneEnvironment(StrEnum):
    env1 = "env1"
    env2 = "env2"


class Engine(StrEnum):
    local = "local"
    dask = "dask"
    ray = "ray"


Host = Annotated[str, typer.Option(help="Address to listen on.")]
Port = Annotated[int, typer.Option(help="Port to listen on.", min=0, max=65535)]


#: The longest line that a refusal takes, in bytes.
_LONGEST_REFUSAL = 4_000


def main() -> None:
    """Run a command. A user's mistake is one line on standard error, and exit status 2."""
    try:
        with closing_studios():
            status = commands(standalone_mode=False)
    except StudyFaults as error:
        fail(str(error))
    except (ServiceError, FolderNotEmptyError, UnknownStudyError) as error:
        # Whole for what is refused in production, which names every setting at once.
        fail(f"pbpo: {shortened(str(error), _LONGEST_REFUSAL)}")
    except (FileExistsError, IsADirectoryError, NotADirectoryError, PermissionError) as error:
        fail(f"pbpo: {error}")
    except OperationalError as error:
        # What the database said, in one line: neither its address nor its password is repeated.
        fail(f"pbpo: the database cannot be used: {' '.join(str(error.orig).split())}")
    except TyperException as error:
        fail(f"pbpo: {shortened(error.format_message())} (pbpo --help shows what there is)")
    except Exit as error:
        sys.exit(error.exit_code)
    except (Abort, KeyboardInterrupt):
        sys.exit(130)
    sys.exit(status if isinstance(status, int) else 0)


def fail(message: str) -> NoReturn:
    print(message, file=sys.stderr)
    sys.exit(MISTAKE)


@commands.command()
def demo(port: Port = 8000, host: Host = "127.0.0.1", data_dir: DataDir = None) -> None:
    """Serve the waste-crane study, set up on the first start."""
    from app.services.studies import demo as demo_service

    from .server import listen, serve_app
    from .simulation import JOBS

    socket = listen(host, port)
    app = app_context_of(data_dir, job_handlers=JOBS)
    address = f"http://{host}:{socket.getsockname()[1]}{app.settings.root_path}"
    access = demo_service.prepare(app, address)

    def say() -> None:
        out.print(
            f"\nPBPO Studio is running.\n\n"
            f"  Take part:   {access.participant_url}\n"
            f"  Videos that are recorded while you choose:\n"
            f"               {address}/s/{demo_service.LIVE_STUDY}\n"
            f"  Experiment:  {access.experimenter_url}\n"
            f"  Sign in as:  {access.email}\n"
            f"  Password:    {access.password}\n\n"
            f"The same is in {app.settings.data_dir / 'access.json'}. Ctrl+C stops.\n"
        )

    serve_app(app, socket, say)


@commands.command()
def serve(
    port: Port = 8000,
    host: Host = "127.0.0.1",
    workers: Annotated[
        int, typer.Option(help="Processes that serve; more than one on PostgreSQL.", min=1, max=64)
    ] = 1,
    data_dir: DataDir = None,
) -> None:
    """Serve the studies that are there. Logs are lines of JSON on standard error."""
    from app.services.monitoring import startup_checks

    from .server import listen, serve_app, serve_with_workers
    from .simulation import JOBS

    startup_checks.require_servable(settings_of(data_dir), workers)
    with listen(host, port) as socket:
        app = app_context_of(data_dir, job_handlers=JOBS)
        startup_checks.require_safe(app, host)
        for sentence in startup_checks.unsafe_settings(app, host):
            print(f"pbpo: {sentence}", file=sys.stderr)
        address = f"http://{host}:{socket.getsockname()[1]}{app.settings.root_path}"
        if workers > 1:
            # Each worker opens it for itself.
            app.close()
            serve_with_workers(app.settings, socket, workers, lambda: out.print(address))
        else:
            serve_app(app, socket, lambda: out.print(address), json_logs=True)


@study_app.command("init")
def study_init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER")],
    machine: Annotated[
        bool, typer.Option("--machine", help="A machine records the videos while people choose.")
    ] = False,
) -> None:
    """Write a commented example of a study of one's own."""
    from app.study.scaffold import init

    init(folder, machine=machine)
    out.print(f"{folder} holds an example. Change it, then: pbpo study check {folder}")


@study_app.command("words")
def study_words(
    language: Annotated[str, typer.Argument(metavar="LANGUAGE", help="Such as de, ar or pt-BR.")],
    file: Annotated[
        Path | None, typer.Option("--out", help="Write it there rather than to the terminal.")
    ] = None,
) -> None:
    """Write a template to translate the words of evaluators' own pages into a language.

    A study that has it as texts/LANGUAGE/words.po is in that language on every page.
    """
    from app.study import page_words

    if page_words.spoken_locale(language) is not None:
        name = page_words.own_name(language)
        raise ConflictError(f"expected a language other than those of the pages, got {name}")
    made = page_words.template(language)
    if file is None:
        typer.echo(made, nl=False)
        return
    if file.exists():
        raise ConflictError(f"expected the name of a new file, got {file}, which there is already")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(made, encoding="utf-8")
    out.print(f"{file} holds the words to translate.")


@study_app.command("check")
def study_check(folder: Folder, data_dir: DataDir = None) -> None:
    """Name every fault in a study's folder, and what is worth knowing of it."""
    found = repository.examine_folder(folder)
    if found.study is None:
        raise StudyFaults(found.faults)
    loaded = found.study
    plan = loaded.plan
    out.print(
        f"{plan.slug}: no fault found. Conditions: {len(plan.conditions)}, trials: {plan.trials},"
        f" queries in each: {plan.queries_per_trial}."
    )
    for line in in_lines(found.remarks):
        out.print(line)
    if found.unused:
        out.print(f"not used by the study: {', '.join(found.unused)}")
    for line in in_lines(repository.doubts_on(loaded)):
        out.print(f"doubt: {line}")
    settings = settings_of(data_dir)
    if settings.database_url or (settings.data_dir / DATABASE_FILE).is_file():
        taken = slugs.unavailable_reason(
            app_context_of(data_dir), plan.slug, slugs.folder_hash(loaded.root)
        )
        if taken is not None:
            out.print(f"{plan.slug}: {taken}")


@study_app.command("create")
def study_create(
    folder: Folder,
    replace: Annotated[
        bool,
        typer.Option(
            "--replace", help="Let a draft of this slug make way that was made of another folder."
        ),
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Store a study as a draft; an earlier draft made of the same folder makes way."""
    loaded = repository.load_folder(folder)
    try:
        info = repository.create(
            app_context_of(data_dir),
            loaded,
            # A draft that somebody made in the browser is theirs.
            may_replace=lambda session, study_id: slugs.owner_of(session, study_id) is None,
            proof=slugs.Proof(is_asked=replace),
        )
    except SlugTakenError as error:
        hint = "its owner alone replaces it" if replace else "--replace lets a draft make way"
        raise SlugTakenError(f"{error} ({hint})") from None
    out.print(
        f"{info.slug}: created as a draft. To let participants in: pbpo study open {info.slug}"
    )


@study_app.command("revise")
def study_revise(folder: Folder, data_dir: DataDir = None) -> None:
    """Give a study new texts. Whoever agreed to another consent is asked again."""
    loaded = repository.load_folder(folder)
    info = revision.revise(app_context_of(data_dir), loaded)
    out.print(f"{info.slug}: texts as of version {info.plan_version}.")


@study_app.command("list")
def study_list(data_dir: DataDir = None) -> None:
    """List the studies."""
    table = Table("slug", "status", "trials", "queries per trial", "plan", box=None)
    for study in repository.all_studies(app_context_of(data_dir)):
        plan = study.plan
        table.add_row(
            study.slug,
            study.status,
            str(plan.trials),
            str(plan.queries_per_trial),
            study.plan_hash[:12],
        )
    out.print(table)


@study_app.command("open")
def study_open(
    slug: Slug,
    yes: Annotated[
        bool, typer.Option("--yes", help="Open it without asking; in a script, it is not asked.")
    ] = False,
    data_dir: DataDir = None,
) -> None:
    """Let participants in, after naming what is doubtful. The plan is final from then on."""
    app = app_context_of(data_dir)
    study = repository.find(app, slug)
    doubts = in_lines(opening.doubts_before_opening(app, study))
    for line in [*doubts, *pace.slower_than_viewing(app, study)]:
        out.print(f"doubt: {line}")
    if study.status == repository.DRAFT and not yes and sys.stdin.isatty():
        typer.confirm(f"Open {slug}? Its plan is final from then on.", abort=True)
    repository.open_study(app, slug)
    entrance = address_of(app, f"/s/{slug}")
    out.print(f"{slug} is open: participants enter at {entrance}")


@study_app.command("close")
def study_close(slug: Slug, data_dir: DataDir = None) -> None:
    """Let nobody in any more; sessions under way may finish."""
    repository.close_study(app_context_of(data_dir), slug)
    out.print(f"{slug} is closed.")


@link_app.command("create")
def link_create(
    slug: Slug,
    count: Annotated[int, typer.Option(help="How many links.", min=1, max=10_000)] = 1,
    label: Annotated[str, typer.Option(help="A note on what they are for.")] = "",
    address: Address = "",
    data_dir: DataDir = None,
) -> None:
    """Make links that each let one person in, once, and show them this once."""
    from app.services.arrival import entry_links

    app = app_context_of(data_dir)
    say_links(app, entry_links.create(app, slug, count, label), address)


@link_app.command("pilot")
def link_pilot(slug: Slug, address: Address = "", data_dir: DataDir = None) -> None:
    """Make a link by which people try the study, without counting. It ends the one before it."""
    from app.services.arrival import pilot_links

    app = app_context_of(data_dir)
    say_links(app, [pilot_links.path_of(slug, pilot_links.make_link(app, slug))], address)


@commands.command()
def simulate(
    slug: Slug,
    sessions: Annotated[int, typer.Option(min=1, max=10_000, help="How many sessions.")] = 1,
    evaluator: Annotated[EvaluatorKind, typer.Option(help="Who answers.")] = EvaluatorKind.certain,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the uncertain evaluator.")] = 0,
    eta: Annotated[
        float | None,
        typer.Option(min=0, help="Steepness per unit of score. Default: by the scores' spread."),
    ] = None,
    people: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=10_000,
            help="So many people with tastes of their own, a session each, in place of --sessions"
            " and --evaluator.",
        ),
    ] = None,
    own_share: Annotated[
        float, typer.Option(min=0, max=1, help="The share of people's taste that is their own.")
    ] = 0.3,
    spammers: Annotated[
        int, typer.Option(min=0, help="How many of the people press any button.")
    ] = 0,
    one_sided: Annotated[
        int, typer.Option(min=0, help="How many of the people always press left.")
    ] = 0,
    at_chance: Annotated[
        int, typer.Option(min=0, help="How many of the people choose by a coin.")
    ] = 0,
    data_dir: DataDir = None,
) -> None:
    """Let simulated evaluators walk through a study; their data is marked as simulated."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress

    from app.lab.session_people import SimulatedPeople
    from app.lab.several_people import SeveralPeopleError, unreliable_kinds

    from .simulation import run

    unreliable = unreliable_kinds(spammers, one_sided, at_chance)
    if people is None and unreliable:
        raise typer.BadParameter("--spammers, --one-sided and --at-chance: expected --people too")
    try:
        crowd = None if people is None else SimulatedPeople(people, own_share, unreliable)
    except SeveralPeopleError as error:
        raise typer.BadParameter(str(error)) from error
    sessions = people or sessions

    progress = Progress("simulating", BarColumn(), MofNCompleteColumn(), console=out)
    task = progress.add_task("", total=sessions)

    def report(now: int, total: int) -> None:
        # Begun when there is something to tell: a mistake is a line on standard error, no more.
        progress.start()
        progress.update(task, completed=now, total=total)

    try:
        settings, kind = settings_of(data_dir), evaluator.value
        done = run(settings, slug, sessions, kind, seed, eta, report=report, people=crowd)
    finally:
        if progress.live.is_started:
            progress.stop()
    out.print(f"{done.completed} simulated sessions of {slug} were completed.")
    out.print(done.in_words())


@commands.command()
def power(
    people: Annotated[
        list[int] | None,
        typer.Option(min=1, max=200, help="How many people; repeatable. Default: 3, 6 and 12."),
    ] = None,
    answers: Annotated[
        list[int] | None,
        typer.Option(
            min=1, max=100, help="How many answers each gives; repeatable. Default: 5, 10 and 20."
        ),
    ] = None,
    own_share: Annotated[
        float, typer.Option(min=0, max=1, help="The share of people's taste that is their own.")
    ] = 0.3,
    within: Annotated[
        float, typer.Option(min=0, max=1, help="How much worse than the best, of the range.")
    ] = 0.1,
    sets: Annotated[int, typer.Option(min=2, max=1000, help="Simulated sets of people.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first set.")] = 0,
) -> None:
    """How many people of how many answers find what people like best, together and apart.

    On simulated people who answer random pairs of a square of two parameters; takes some minutes.
    """
    from app.lab.consensus_tables import with_error
    from app.lab.people_needed import in_words, sweep

    found = []
    out.print("people  answers  shared model   pooled         a model each")
    each = answers or [5, 10, 20]
    for one in sweep(people or [3, 6, 12], each, own_share, range(seed, seed + sets)):
        found.append(one)
        regrets = "  ".join(with_error(way) for way in (one.shared, one.pooled, one.own))
        out.print(f"{one.people:6}  {one.answers:7}  {regrets}")
    out.print(f"For a mean regret of {within:g} of the range or less, by one standard error:")
    for sentence in in_words(found, within):
        out.print(sentence)


@media_app.command("render")
def media_render(
    environment: Annotated[
        CraneEnvironment | None, typer.Option(help="Only this one; default: both.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, max=64, help="Processes at work.")] = 2,
    media_dir: Annotated[
        Path | None, typer.Option(help="[env: PBPO_MEDIA_DIR; default: media]", show_default=False)
    ] = None,
) -> None:
    """Render the crane's recordings ahead. Interrupted, it goes on where it was."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from app.crane.rendering_jobs import render_all
    from app.services.recordings.recordings import keep_rendered

    settings = settings_of(None)
    target = media_dir or settings.media_dir
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress("rendering", *columns, console=out) as progress:
        task = progress.add_task("")
        render_all(
            environment and environment.value,
            target,
            jobs,
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    out.print(f"All recordings are in {target}.")
    if settings.recordings_url:
        keep_rendered(settings, target)
        out.print(f"They are in {settings.recordings_url}, too.")


@commands.command()
def replay(slug: Slug, data_dir: DataDir = None) -> None:
    """Work every trial out again from the responses; exit 1 if anything comes out otherwise."""
    from app.services.sessions.replay import replay as replay_study

    different = queries = trials = withdrawn = gone = earlier = 0
    for trial in replay_study(app_context_of(data_dir), slug):
        trials += 1
        queries += trial.queries
        withdrawn += trial.withdrawn
        gone += trial.gone
        earlier += trial.earlier
        different += len(trial.differences)
        for difference in trial.differences:
            out.print(
                f"{trial.session_id} trial {trial.trial_index} ({trial.condition}) "
                f"{difference.what}: stored {difference.stored}, "
                f"worked out {difference.worked_out}"
            )
    out.print(f"{trials} trials, {queries} queries replayed; {different} came out otherwise.")
    if withdrawn:
        out.print(f"{withdrawn} responses are not learnt from: their recordings were withdrawn.")
    if gone:
        out.print(
            f"{gone} pairs and acquired candidates of shared models cannot be worked out again: "
            "answers that they came from were deleted or taken back since. They stay as they were."
        )
    if earlier:
        out.print(
            f"{earlier} pairs and acquired candidates of shared models are not compared: their "
            "trials began under an earlier version of the optimiser, whose steps differ."
        )
    raise Exit(1 if different else 0)


@commands.command()
def reproduce(
    out_dir: Annotated[Path, typer.Option("--out", help="Folder to write to, and to go on in.")],
    figures: Annotated[
        str | None, typer.Option(help="The paper's figures, as in 10,12; default: all.")
    ] = None,
    trials: Annotated[
        int | None, typer.Option(min=2, help="Of each method; default: as many as the paper.")
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, max=256, help="Trials at a time.")] = 1,
    engine: Annotated[Engine, typer.Option(help="Where trials run.")] = Engine.local,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another set of trials.")] = 0,
) -> None:
    """Run the paper's experiments again; interrupted, it goes on where it was."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    from app.lab.engines import EngineError
    from app.lab.experiments import ExperimentError, chosen_figures
    from app.lab.reproduce import reproduce as reproduce_figures
    from app.lab.store import OtherResultsError

    columns = (BarColumn(), MofNCompleteColumn(), "trials", TimeRemainingColumn())
    with Progress("reproducing", *columns, console=out) as progress:
        task = progress.add_task("")
        try:
            report = reproduce_figures(
                out_dir,
                figures=chosen_figures(figures),
                trials=trials,
                seed=seed,
                jobs=jobs,
                engine=engine.value,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
            )
        except (EngineError, ExperimentError, OtherResultsError) as error:
            raise typer.BadParameter(str(error)) from error
    out.print(str(report))


if __name__ == "__main__":
    main()
