//! How our own operations enter burn: on `Device::flex()`, with autodiff or without.
//!
//! An [`Operation`] defines its outputs and its gradients; [`run`] runs it and, with autodiff, records it.
//! Every other device runs the operations of burn: [`is_own`] says whether ours can run.

use std::fmt::Debug;

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::NoCheckpointing};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend, Flex, TensorMetadata};
use burn::tensor::{DType, Device, Shape, Tensor, TensorData};

type FlexAutodiff = Autodiff<Flex, NoCheckpointing>;

/// Whether our operations can run on a tensor.
pub(super) fn is_own<const D: usize>(x: &Tensor<D>) -> bool {
    // `==` on devices compares the hardware and leaves autodiff aside.
    x.device() == Device::flex() && x.dtype() == DType::F32 && x.shape().num_elements() > 0
}

/// An operation on N tensors. All tensors that it gets are contiguous.
pub(super) trait Operation<const N: usize>: Debug + Send + 'static {
    /// The values that the gradients need.
    type Saved: Debug + Clone + Send + 'static;

    /// Computes the outputs. The first has gradients, the others are apart from autodiff.
    fn forward(&self, inputs: [FlexTensor; N]) -> (Vec<FlexTensor>, Self::Saved);

    /// Computes the gradients of the inputs from that of the first output, at least of those that are wanted.
    fn gradients(&self, saved: Self::Saved, dy: &FlexTensor, wanted: [bool; N]) -> [Option<FlexTensor>; N];
}

/// The values of a contiguous tensor.
pub(super) fn values(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("`run` makes tensors contiguous, and `is_own` asks for f32")
}

/// The sizes of a tensor's axes.
pub(super) fn dims<const D: usize>(tensor: &FlexTensor) -> [usize; D] {
    std::array::from_fn(|axis| tensor.shape()[axis])
}

pub(super) fn tensor(values: Vec<f32>, shape: impl Into<Shape>) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

/// An input or output of an operation, of any rank.
pub(super) enum Operand {
    Plain(FlexTensor),
    Autodiff(FloatTensor<FlexAutodiff>),
}

impl<const D: usize> From<Tensor<D>> for Operand {
    fn from(tensor: Tensor<D>) -> Self {
        const WHY: &str = "`is_own` found a flex tensor, and nothing turns gradient checkpointing on";
        if tensor.device().is_autodiff() {
            Self::Autodiff(tensor.try_into_primitive::<FlexAutodiff>().expect(WHY))
        } else {
            Self::Plain(tensor.try_into_primitive::<Flex>().expect(WHY))
        }
    }
}

impl Operand {
    fn into_tensor<const D: usize>(self) -> Tensor<D> {
        match self {
            Self::Plain(tensor) => Tensor::from_primitive::<Flex>(tensor),
            Self::Autodiff(tensor) => Tensor::from_primitive::<FlexAutodiff>(tensor),
        }
    }

    fn into_autodiff(self) -> FloatTensor<FlexAutodiff> {
        match self {
            Self::Plain(tensor) => FlexAutodiff::from_inner(tensor),
            Self::Autodiff(tensor) => tensor,
        }
    }
}

/// The outputs of an operation, in order.
pub(super) struct Outputs(std::vec::IntoIter<Operand>);

impl Outputs {
    pub fn next<const D: usize>(&mut self) -> Tensor<D> {
        self.0.next().expect("callers know how many outputs there are").into_tensor()
    }
}

/// Runs an operation on tensors for which [`is_own`] holds.
pub(super) fn run<O: Operation<N>, const N: usize>(operation: O, inputs: [Operand; N]) -> Outputs {
    if inputs.iter().any(|input| matches!(input, Operand::Autodiff(_))) {
        return record(operation, inputs.map(Operand::into_autodiff));
    }
    let inputs = inputs.map(|input| match input {
        Operand::Plain(tensor) => tensor.to_contiguous(),
        Operand::Autodiff(_) => unreachable!("then `record` runs it"),
    });
    let outputs: Vec<Operand> = operation.forward(inputs).0.into_iter().map(Operand::Plain).collect();
    Outputs(outputs.into_iter())
}

/// Runs an operation and records it for the backward pass.
fn record<O: Operation<N>, const N: usize>(operation: O, inputs: [FloatTensor<FlexAutodiff>; N]) -> Outputs {
    let nodes = inputs.each_ref().map(FloatTensor::<FlexAutodiff>::node);
    let (outputs, saved) = operation.forward(inputs.map(|input| input.into_primitive().to_contiguous()));
    let mut outputs = outputs.into_iter();
    let first = outputs.next().expect("an operation has an output");
    let first = match Recorded(operation).prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prep) => prep.finish(saved, first),
        OpsKind::UnTracked(prep) => prep.finish(first),
    };
    let all: Vec<Operand> =
        std::iter::once(first).chain(outputs.map(FlexAutodiff::from_inner)).map(Operand::Autodiff).collect();
    Outputs(all.into_iter())
}

/// An operation in the graph of autodiff.
#[derive(Debug)]
struct Recorded<O>(O);

impl<O: Operation<N>, const N: usize> Backward<Flex, N> for Recorded<O> {
    type State = O::Saved;

    fn backward(self, ops: Ops<Self::State, N>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let dy = grads.consume::<Flex>(&ops.node).to_contiguous();
        let wanted = ops.parents.each_ref().map(Option::is_some);
        for (node, gradient) in ops.parents.into_iter().zip(self.0.gradients(ops.state, &dy, wanted)) {
            if let (Some(node), Some(gradient)) = (node, gradient) {
                grads.register::<Flex>(node.id, gradient);
            }
        }
    }
}
