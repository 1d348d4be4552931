"""Judge whether a candidate of a bisection behaves otherwise than the good end (`bisect --behaves`)."""

from __future__ import annotations

from dataclasses import dataclass

from harness.model import Phase
from harness.model.hostile_data import Unreadable
from harness.physics import sentences
from harness.physics.comparison import compare
from harness.physics.outputs import Bank, Outputs
from harness.probes import array_files
from harness.probes.evidence import OUTPUTS
from harness.probes.vault import Vault
from harness.rootcause.bench import Trial
from harness.rootcause.bisection.predicate import Classification
from harness.rootcause.search import Answer
from harness.running import behaviour_runs


@dataclass(frozen=True, kw_only=True, slots=True)
class BehaviourPredicate:
    """The behaviour that a bisection looks for: any other than that of `reference`, from the states of a bank."""

    env: str
    bank: Bank
    vault: Vault
    reference: str
    outputs: Outputs

    @property
    def until(self) -> Phase:
        """Return the last phase that matters."""
        return Phase.BEHAVE

    @property
    def words(self) -> str:
        """Return the definition of bad in words."""
        return f"{self.env} behaves differently from {self.reference}"

    def classify(self, trial: Trial) -> Classification:
        """Return the answer of a trial."""
        outputs = read_outputs(trial, self.vault)
        if outputs is None:
            return Classification(answer=Answer.UNTESTABLE, why=None, words=trial.failure_text)
        comparison = compare(self.outputs, outputs, self.bank)
        answers = {True: Answer.BAD, False: Answer.GOOD, None: Answer.UNTESTABLE}
        answer = answers[comparison.behaves_otherwise]
        return Classification(answer=answer, why=None, words=sentences.describe(comparison))


@dataclass(frozen=True, kw_only=True, slots=True)
class BehaviourTask:
    """The environment whose behaviour is bisected, and the bank (its SHA-256 in the vault) that it is stepped from."""

    env: str
    bank: str
    vault: Vault

    def compare_with(self, reference: str, trial: Trial) -> BehaviourPredicate | None:
        """Return the predicate whose reference is this trial; None if the trial left no outputs."""
        outputs = read_outputs(trial, self.vault)
        if outputs is None or not outputs.steps_from_bank:
            return None
        bank = behaviour_runs.read_bank(self.bank, self.vault)
        return BehaviourPredicate(env=self.env, bank=bank, vault=self.vault, reference=reference, outputs=outputs)


def read_outputs(trial: Trial, vault: Vault) -> Outputs | None:
    """Return what the states of the bank led to in a measured cell; None if it was not stepped from them."""
    for case in trial.record.cases:
        try:
            arrays = behaviour_runs.arrays_of(case, OUTPUTS, vault)
        except Unreadable:
            continue
        if arrays is not None:
            return Outputs(arrays, array_files.facts(arrays))
    return None
